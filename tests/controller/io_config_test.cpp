#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "controller/config.h"
#include "tests/support/job_folder.h"

namespace reforge {
namespace {

using nlohmann::json;
using reforge::testing::read_file;

// The shipped file, with groups that exist on every machine.
json shipped() {
  json config =
      json::parse(read_file(std::filesystem::path(REFORGE_SOURCE_DIR) / "config/reforged.json"));
  for (auto& [name, role] : config["roles"].items()) role["groups"] = json::array();
  return config;
}

Error refused(const json& config) {
  const auto parsed = parse_config(config.dump(), "reforged.json");
  EXPECT_FALSE(parsed.ok());
  return parsed ? Error{} : parsed.error();
}

TEST(DaemonConfig, ShippedFileIsUnderstood) {
  const auto parsed = parse_config(shipped().dump(), "reforged.json");
  ASSERT_TRUE(parsed.ok()) << parsed.error().sentence;
  EXPECT_EQ(parsed->cnc.kind, PortKind::kSerial);
  EXPECT_FALSE(parsed->virtual_ports());
  EXPECT_FALSE(parsed->clock.has_value());
  EXPECT_EQ(parsed->verifier.memory_mib, 4096);
}

TEST(DaemonConfig, UnknownKeyIsNamed) {
  json config = shipped();
  config["ports"]["cnc"]["baud"] = 9600;
  const Error error = refused(config);
  EXPECT_EQ(error.code, Code::kUnknownKey);
  EXPECT_NE(error.sentence.find("ports.cnc.baud"), std::string::npos) << error.sentence;
}

TEST(DaemonConfig, MissingKeyIsNamed) {
  for (const char* key : {"format", "socket", "state_directory", "rig", "clock", "ports", "roles",
                          "verifier", "limits"}) {
    json config = shipped();
    config.erase(key);
    EXPECT_NE(refused(config).sentence.find(key), std::string::npos) << key;
  }
}

TEST(DaemonConfig, RelativePathIsRefused) {
  json config = shipped();
  config["socket"] = "run/reforged.sock";
  EXPECT_EQ(refused(config).code, Code::kMalformed);
}

TEST(DaemonConfig, SocketPathLongerThanTheKernelTakesIsRefused) {
  json config = shipped();
  config["socket"] = "/" + std::string(107, 'x');
  EXPECT_EQ(refused(config).code, Code::kOutOfRange);
}

TEST(DaemonConfig, VirtualClockWithARealPortIsRefused) {
  json config = shipped();
  config["clock"] = "/run/clock.sock";
  config["ports"]["cnc"]["kind"] = "virtual";
  EXPECT_NE(refused(config).sentence.find("clock"), std::string::npos);
  config["ports"]["extruder"]["kind"] = "virtual";
  EXPECT_TRUE(parse_config(config.dump(), "reforged.json").ok());
}

TEST(DaemonConfig, GroupNobodyKnowsIsNamed) {
  json config = shipped();
  config["roles"]["operate"]["groups"] = {"no-such-group-anywhere"};
  EXPECT_NE(refused(config).sentence.find("no-such-group-anywhere"), std::string::npos);
}

TEST(DaemonConfig, AbsentFileIsASentence) {
  EXPECT_EQ(read_config("/nonexistent/reforged.json").error().code, Code::kUnreadable);
}

}  // namespace
}  // namespace reforge
