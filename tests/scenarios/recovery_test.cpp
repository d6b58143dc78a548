// An interrupted job is finished by another: from a checkpoint, with a preamble that was verified
// against the simulated stock of that moment, on the operator's word.
#include <gtest/gtest.h>

#include <sstream>

#include "tests/scenarios/shop.h"
#include "tests/scenarios/tiny_pair.h"

namespace reforge {
namespace {

using api::JobState;
using api::Method;
using nlohmann::json;
using reforge::testing::of_kind;
using reforge::testing::planned_job;
using reforge::testing::Shop;

std::size_t beads_of(const std::string& program) {
  std::size_t out = 0;
  std::istringstream lines(program);
  for (std::string line; std::getline(lines, line);) out += line.starts_with("M72") ? 1 : 0;
  return out;
}

class Recovery : public ::testing::Test {
 protected:
  // Starts the planned job and kills the daemon once `reached` holds; a new daemon, cleared.
  void interrupt(const std::function<bool()>& reached) {
    shop_.config["verifier"] = {{"command", {REFORGE_CLI, "verify", "--json"}},
                                {"limits", nullptr}};
    shop_.start_rig();
    shop_.start_daemon();
    job_ = shop_.call(Method::kSubmit, {{"path", planned_job().string()}}).at("job");
    ASSERT_TRUE(shop_.wait_for_state(job_, JobState::kReady)) << shop_.job(job_).reason;
    ASSERT_TRUE(shop_.wait_until([&] { return shop_.rig_state() == "idle"; }));
    shop_.start(job_);
    ASSERT_TRUE(shop_.wait_until(reached));
    ASSERT_EQ(shop_.job(job_).state, JobState::kRunning) << "over before it could be interrupted";
    shop_.kill_daemon();
    // The board's dead-man: heat off, and its hold output dropped.
    ASSERT_TRUE(shop_.wait_until([&] {
      const auto permits = of_kind(shop_.trace(), "permit");
      return !permits.empty() && permits.back().at("run") == false;
    }));
    shop_.start_daemon();
    ASSERT_TRUE(shop_.wait_until([&] {
      const std::string state = shop_.rig_state();
      return state == "suspended" || state == "fault" || state == "idle";
    }));
    shop_.call(Method::kClear);
    ASSERT_TRUE(shop_.wait_until([&] { return shop_.rig_state() == "idle"; }))
        << shop_.daemon_log();
  }

  void finish(std::int64_t job) {
    ASSERT_TRUE(shop_.wait_for_state(job, JobState::kReady)) << shop_.job(job).reason;
    const auto refused = shop_.try_call(Method::kStart, {{"job", job}});
    ASSERT_FALSE(refused.ok());
    EXPECT_NE(refused.error().sentence.find("homed, preamble"), std::string::npos);
    shop_.start(job);
    ASSERT_TRUE(shop_.wait_until([&] { return is_over(shop_.job(job).state); }));
    EXPECT_EQ(shop_.job(job).state, JobState::kDone) << shop_.job(job).reason << shop_.daemon_log();
    EXPECT_EQ(shop_.job(job).recovers, job_);
  }

  Shop shop_;
  std::int64_t job_ = 0;
};

TEST_F(Recovery, MillingGoesOnFromACheckpoint) {
  // Early: what may have been sent reaches some 190 lines further, and must end before the first
  // bead.
  ASSERT_NO_FATAL_FAILURE(interrupt([&] { return shop_.job(job_).acknowledged > 20; }));
  const json made = shop_.call(Method::kRecover, {{"job", job_}});
  EXPECT_LE(made.at("from_line"), shop_.job(job_).executed + 20);
  ASSERT_NO_FATAL_FAILURE(finish(made.at("job")));
  EXPECT_TRUE(of_kind(shop_.trace(), "fault").empty());
}

TEST_F(Recovery, PrintingGoesOnAndNoBeadIsLaidTwice) {
  ASSERT_NO_FATAL_FAILURE(
      interrupt([&] { return of_kind(shop_.trace(), "extrude_on").size() > 3; }));
  const std::size_t begun = of_kind(shop_.trace(), "extrude_on").size();
  std::size_t again = 0;
  auto made = shop_.try_call(Method::kRecover, {{"job", job_}});
  if (!made) {
    EXPECT_NE(made.error().sentence.find("half laid"), std::string::npos) << made.error().sentence;
    made = shop_.try_call(Method::kRecover, {{"job", job_}, {"bead", "removed"}});
    again = 1;
  }
  ASSERT_TRUE(made.ok()) << made.error().sentence;
  EXPECT_EQ(made->at("preamble").at(5).get<std::string>().substr(0, 3), "M70");
  ASSERT_NO_FATAL_FAILURE(finish(made->at("job")));
  const std::size_t all = of_kind(shop_.trace(), "extrude_on").size();
  const std::size_t planned = beads_of(testing::read_file(planned_job() / "program.nc"));
  // Every bead of the program, the one that was taken off, and the purge. A bead that was only
  // allowed, and never begun, was not begun the first time either.
  EXPECT_GE(all, planned + 1);
  EXPECT_LE(all, planned + again + 1);
  EXPECT_GT(begun, 3u);
}

}  // namespace
}  // namespace reforge
