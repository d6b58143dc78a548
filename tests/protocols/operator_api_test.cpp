#include "protocols/operator_api.h"

#include <gtest/gtest.h>

namespace reforge::api {
namespace {

using nlohmann::json;

int refused(std::string_view line) {
  const auto parsed = parse_request(line);
  const auto* refusal = std::get_if<Refusal>(&parsed);
  return refusal == nullptr ? 0 : refusal->failure.code;
}

TEST(OperatorApi, RequestIsTakenApart) {
  const auto parsed =
      parse_request(R"({"jsonrpc":"2.0","id":"a","method":"start","params":{"job":3}})");
  const auto& request = std::get<Request>(parsed);
  EXPECT_EQ(request.method, Method::kStart);
  EXPECT_EQ(request.id, "a");
  EXPECT_TRUE(request.answered);
  EXPECT_EQ(request.params.at("job"), 3);
}

TEST(OperatorApi, RequestWithoutIdIsNotAnswered) {
  const auto parsed = parse_request(R"({"jsonrpc":"2.0","method":"hold"})");
  EXPECT_FALSE(std::get<Request>(parsed).answered);
}

TEST(OperatorApi, MalformedLinesAreRefusedByTheirKind) {
  EXPECT_EQ(refused(""), kParseError);
  EXPECT_EQ(refused("{"), kParseError);
  EXPECT_EQ(refused("\xff\xfe\x00"), kParseError);
  EXPECT_EQ(refused(std::string(60000, '[')), kParseError);
  EXPECT_EQ(refused("[]"), kInvalidRequest);
  EXPECT_EQ(refused("null"), kInvalidRequest);
  EXPECT_EQ(refused("{}"), kInvalidRequest);
  EXPECT_EQ(refused(R"({"jsonrpc":"1.0","method":"hold"})"), kInvalidRequest);
  EXPECT_EQ(refused(R"({"jsonrpc":"2.0","id":{},"method":"hold"})"), kInvalidRequest);
  EXPECT_EQ(refused(R"({"jsonrpc":"2.0","id":1.5,"method":"hold"})"), kInvalidRequest);
  EXPECT_EQ(refused(R"({"jsonrpc":"2.0","method":7})"), kInvalidRequest);
  EXPECT_EQ(refused(R"({"jsonrpc":"2.0","method":"hold","extra":1})"), kInvalidRequest);
  EXPECT_EQ(refused(R"({"jsonrpc":"2.0","method":"jump"})"), kMethodNotFound);
  EXPECT_EQ(refused(R"({"jsonrpc":"2.0","method":"hold","params":[1]})"), kInvalidParams);
}

TEST(OperatorApi, ParamsNameWhatIsWrong) {
  const auto fault = [](const char* text) {
    const json object = json::parse(text);
    Params params(object);
    params.number("job", 1, 100);
    params.flag("word");
    return params.fault();
  };
  EXPECT_EQ(fault(R"({"job":7,"word":true})"), "");
  EXPECT_NE(fault(R"({})").find("job"), std::string::npos);
  EXPECT_NE(fault(R"({"job":0})").find("from 1 to 100"), std::string::npos);
  EXPECT_NE(fault(R"({"job":18446744073709551615})").find("from 1 to 100"), std::string::npos);
  EXPECT_NE(fault(R"({"job":1.5})").find("job"), std::string::npos);
  EXPECT_NE(fault(R"({"job":1,"word":"yes"})").find("word"), std::string::npos);
  EXPECT_NE(fault(R"({"job":1,"jbo":2})").find("jbo"), std::string::npos);
}

TEST(OperatorApi, JobReportSurvivesTheWire) {
  JobReport sent;
  sent.job = 3;
  sent.name = "bracket \"two\"";
  sent.state = JobState::kInterrupted;
  sent.lines = 100;
  sent.executed = 10;
  sent.acknowledged = 20;
  sent.horizon = 60;
  sent.machine_s = 12.25;
  sent.uncertain = LineRange{21, 60};
  sent.checklist = {{"stock", "Is it clamped?", "anna"}, {"zero", "Is it set?", ""}};
  const auto read = job_report(json::parse(to_json(sent).dump()));
  ASSERT_TRUE(read.ok()) << read.error().sentence;
  EXPECT_EQ(to_json(*read), to_json(sent));
}

TEST(OperatorApi, EveryStateHasANameOfItsOwn) {
  for (int i = 0; i < kJobStateCount; ++i) {
    const auto state = static_cast<JobState>(i);
    EXPECT_EQ(job_state_named(name_of(state)), state);
  }
  EXPECT_EQ(job_state_named("waiting"), std::nullopt);
}

TEST(OperatorApi, WrongBytesFromADeviceDoNotSpoilAMessage) {
  EXPECT_TRUE(json::accept(notification("log", {{"sentence", "CNC: \xff\xfe"}})));
}

}  // namespace
}  // namespace reforge::api
