// What must be proved and confirmed before anything moves: the real verifier on a really planned
// job, and every way in which a job is refused.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "protocols/certificate.h"
#include "tests/scenarios/shop.h"
#include "tests/scenarios/tiny_pair.h"
#include "tests/support/job_folder.h"

namespace reforge {
namespace {

namespace fs = std::filesystem;
using api::JobState;
using api::Method;
using nlohmann::json;
using reforge::testing::make_job;
using reforge::testing::of_kind;
using reforge::testing::planned_job;
using reforge::testing::Process;
using reforge::testing::read_file;
using reforge::testing::Shop;
using reforge::testing::write_file;

const char* const kShort = "G21\nG90\nG94\nG17\nG54\nG0 Z100\nG1 X1 F500\nM30\n";

bool says(const std::string& text, const char* what) {
  return text.find(what) != std::string::npos;
}

class Proof : public ::testing::Test {
 protected:
  void begin(const json& verifier_command = {REFORGE_CLI, "verify", "--json"}) {
    shop_.config["verifier"] = {{"command", verifier_command},
                                {"limits", {{"memory_mib", 4096}, {"seconds", 300}}}};
    if (sanitized()) shop_.config["verifier"]["limits"] = nullptr;
    shop_.start_rig();
    shop_.start_daemon();
  }
  // The sanitizer's shadow is more address space than any limit.
  static bool sanitized() {
#ifdef __SANITIZE_ADDRESS__
    return true;
#else
    return false;
#endif
  }
  fs::path copy_of_planned() {
    fs::copy(planned_job(), shop_.folder() / "job", fs::copy_options::recursive);
    return shop_.folder() / "job";
  }
  Result<json> submit(const fs::path& folder) {
    return shop_.try_call(Method::kSubmit, {{"path", folder.string()}});
  }
  std::int64_t submitted(const fs::path& folder) {
    return shop_.call(Method::kSubmit, {{"path", folder.string()}}).at("job").get<std::int64_t>();
  }
  Error start_refusal(std::int64_t job) {
    const auto started = shop_.try_call(Method::kStart, {{"job", job}});
    EXPECT_FALSE(started.ok());
    return started ? Error{} : started.error();
  }

  Shop shop_;
};

TEST_F(Proof, PlannedJobIsVerifiedConfirmedAndRunToItsEnd) {
  begin();
  const auto job = submitted(planned_job());
  ASSERT_TRUE(shop_.wait_for_state(job, JobState::kReady)) << shop_.job(job).reason;
  ASSERT_TRUE(shop_.wait_until([&] { return shop_.rig_state() == "idle"; }));

  EXPECT_TRUE(says(start_refusal(job).sentence, "stock, zero, tool, filament, hot, plate"));
  EXPECT_FALSE(shop_.try_call(Method::kConfirm, {{"job", job}, {"items", {"weather"}}}).ok());
  for (const char* item : {"stock", "zero", "tool", "filament", "hot"}) {
    shop_.call(Method::kConfirm, {{"job", job}, {"items", {item}}});
  }
  EXPECT_TRUE(says(start_refusal(job).sentence, "confirm plate."));
  shop_.call(Method::kConfirm, {{"job", job}, {"items", {"plate"}}});
  shop_.call(Method::kStart, {{"job", job}});
  ASSERT_TRUE(shop_.wait_until([&] { return is_over(shop_.job(job).state); }));
  ASSERT_EQ(shop_.job(job).state, JobState::kDone) << shop_.job(job).reason;
  EXPECT_EQ(shop_.rows("confirmations"), 6);
  EXPECT_GT(of_kind(shop_.trace(), "extrude_on").size(), 3u);
  EXPECT_TRUE(of_kind(shop_.trace(), "fault").empty());
}

TEST_F(Proof, ProgramChangedByAByteIsRefused) {
  begin();
  const fs::path folder = copy_of_planned();
  std::string program = read_file(folder / "program.nc");
  const std::size_t at = program.rfind("F500");
  ASSERT_NE(at, std::string::npos);
  program[at + 1] = '4';
  write_file(folder / "program.nc", program);
  const auto refused = submit(folder);
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.error().code, Code::kHashMismatch);

  // Bound to the certificate by whoever changed it: the daemon's own verification disagrees.
  auto certificate = read_certificate(folder / "certificate.json");
  ASSERT_TRUE(certificate.ok());
  certificate->sha256["program"] = sha256_hex(program);
  testing::write_certificate(folder, *certificate);
  const auto job = submitted(folder);
  ASSERT_TRUE(shop_.wait_for_state(job, JobState::kFailed));
  EXPECT_TRUE(says(shop_.job(job).reason, "verifier refuses")) << shop_.job(job).reason;
  EXPECT_EQ(start_refusal(job).code, Code::kRefused);
}

TEST_F(Proof, JobWithoutCertificateIsRefused) {
  begin();
  const fs::path folder = copy_of_planned();
  fs::remove(folder / "certificate.json");
  const auto refused = submit(folder);
  ASSERT_FALSE(refused.ok());
  EXPECT_TRUE(says(refused.error().sentence, "certificate.json")) << refused.error().sentence;
}

TEST_F(Proof, ProgramThatCollidesIsRefusedWhateverItsCertificateSays) {
  begin();
  const fs::path folder = shop_.folder() / "dive";
  make_job(folder, "G21\nG90\nG94\nG17\nG54\nG0 X0 Y0\nG0 Z-55\nM30\n");
  const auto job = submitted(folder);
  ASSERT_TRUE(shop_.wait_for_state(job, JobState::kFailed));
  EXPECT_TRUE(says(shop_.job(job).reason, "verifier refuses")) << shop_.job(job).reason;
}

TEST_F(Proof, AdministratorAdmitsWhatTheVerifierRefusesAndTheJournalKnows) {
  begin({"/bin/false"});
  make_job(shop_.folder() / "odd", kShort);
  const auto job = submitted(shop_.folder() / "odd");
  ASSERT_TRUE(shop_.wait_for_state(job, JobState::kFailed));
  EXPECT_FALSE(shop_.try_call(Method::kAdmit, {{"job", job}}).ok());
  EXPECT_FALSE(shop_.try_call(Method::kAdmit, {{"job", job}, {"reason", ""}}).ok());
  shop_.call(Method::kAdmit, {{"job", job}, {"reason", "air cut without stock"}});
  EXPECT_EQ(shop_.job(job).state, JobState::kReady);
  EXPECT_TRUE(says(shop_.job(job).reason, "air cut without stock"));
  EXPECT_TRUE(shop_.wait_until(
      [&] { return shop_.rows("acts WHERE method='admit' AND outcome='ok'") == 1; }));
  ASSERT_TRUE(shop_.wait_until([&] { return shop_.rig_state() == "idle"; }));
  shop_.start(job);
  ASSERT_TRUE(shop_.wait_until([&] { return is_over(shop_.job(job).state); }));
  EXPECT_EQ(shop_.job(job).state, JobState::kDone) << shop_.job(job).reason;
  // What has run is not admitted again.
  EXPECT_FALSE(shop_.try_call(Method::kAdmit, {{"job", job}, {"reason", "again"}}).ok());
}

TEST_F(Proof, ConfirmationsAreVoidOnceAJobHadTheRig) {
  begin({"/bin/true"});
  const auto first = shop_.ready_job("first", kShort);
  const auto second = shop_.ready_job("second", kShort);
  ASSERT_TRUE(shop_.wait_until([&] { return shop_.rig_state() == "idle"; }));
  shop_.call(Method::kConfirm, {{"job", second}});
  shop_.start(first);
  ASSERT_TRUE(shop_.wait_until([&] { return is_over(shop_.job(first).state); }));
  EXPECT_TRUE(says(start_refusal(second).sentence, "stock, zero, tool."));
}

TEST_F(Proof, PaperJobRunsOnVirtualPortsOnly) {
  // A commissioned rig on real ports, as far as the configuration knows.
  json rig = json::parse(read_file(testing::shipped_rig_file()));
  rig["commissioned"] = {{"by", "anna"}, {"date", "2026-01-01"}, {"note", "scenario"}};
  write_file(shop_.folder() / "rig.json", rig.dump());
  shop_.config["rig"] = (shop_.folder() / "rig.json").string();
  shop_.config["clock"] = "monotonic";
  for (const char* port : {"cnc", "extruder"}) shop_.config["ports"][port]["kind"] = "serial";
  shop_.config["verifier"]["command"] = {"/bin/true"};
  shop_.start_rig("1");
  shop_.start_daemon();
  const fs::path folder = shop_.folder() / "paper";
  make_job(folder, kShort);
  auto certificate = read_certificate(folder / "certificate.json");
  ASSERT_TRUE(certificate.ok());
  write_file(folder / "rig.json", rig.dump());
  certificate->sha256["rig"] = sha256_hex(rig.dump());
  certificate->mode = Mode::kPaper;
  testing::write_certificate(folder, *certificate);
  const auto job = submitted(folder);
  ASSERT_TRUE(shop_.wait_for_state(job, JobState::kReady));
  ASSERT_TRUE(shop_.wait_until([&] { return shop_.rig_state() == "idle"; })) << shop_.daemon_log();
  shop_.call(Method::kConfirm, {{"job", job}});
  EXPECT_TRUE(says(start_refusal(job).sentence, "virtual ports only"));
  EXPECT_EQ(shop_.job(job).state, JobState::kReady);
}

TEST_F(Proof, UncommissionedRigRefusesRealPorts) {
  shop_.config["clock"] = "monotonic";
  shop_.config["ports"]["cnc"]["kind"] = "serial";
  write_file(shop_.folder() / "reforged.json", shop_.config.dump());
  Process daemon({REFORGE_DAEMON, "--config", (shop_.folder() / "reforged.json").string()}, {},
                 shop_.folder() / "reforged.log");
  EXPECT_EQ(daemon.end_within(30), 78);
  EXPECT_TRUE(says(shop_.daemon_log(), "commissioned")) << shop_.daemon_log();
}

TEST_F(Proof, VerifierBeyondItsMemoryIsEnded) {
  if (sanitized()) GTEST_SKIP();
  shop_.config["verifier"] = {
      {"command", {"/bin/sh", "-c", "x=$(head -c 300000000 /dev/zero | tr '\\0' a); :"}},
      {"limits", {{"memory_mib", 64}, {"seconds", 60}}}};
  shop_.start_rig();
  shop_.start_daemon();
  make_job(shop_.folder() / "big", kShort);
  const auto job = submitted(shop_.folder() / "big");
  EXPECT_TRUE(shop_.wait_for_state(job, JobState::kFailed)) << shop_.job(job).reason;
}

}  // namespace
}  // namespace reforge
