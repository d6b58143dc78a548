// One planned job, its daemon killed (-9) at random instants again and again, each time finished by
// a recovery that is verified, started, and killed in turn, until the job is done.
//
// REFORGE_KILLS: how many kills (20; tools/soak takes 1,000). REFORGE_SEED: of the instants.
#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <random>
#include <sstream>
#include <thread>

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

int number_from(const char* variable, int otherwise) {
  const char* text = std::getenv(variable);
  return text == nullptr ? otherwise : std::atoi(text);
}

// Where a bead begins, in hundredths of a millimetre and degree.
using Place = std::array<long, 5>;

Place place_of(const json& record) {
  Place out{};
  const char* axes[] = {"x", "y", "z", "b", "c"};
  for (std::size_t i = 0; i < 5; ++i) {
    out[i] = std::lround(record.at(axes[i]).get<double>() * 100);
  }
  return out;
}

class Kills : public ::testing::Test {
 protected:
  std::int64_t submit() {
    return shop_.call(Method::kSubmit, {{"path", planned_job().string()}}).at("job");
  }

  void start(std::int64_t job) {
    ASSERT_TRUE(shop_.wait_for_state(job, JobState::kReady)) << shop_.job(job).reason;
    ASSERT_TRUE(shop_.wait_until([&] { return shop_.rig_state() == "idle"; }))
        << shop_.daemon_log();
    shop_.start(job);
  }

  // What must be true whenever the daemon is killed.
  void judge_interruption(std::int64_t job, const api::JobReport& told) {
    const auto report = shop_.job(job);
    if (report.state == JobState::kDone) return;
    EXPECT_EQ(report.state, JobState::kInterrupted);
    EXPECT_GE(report.acknowledged, told.acknowledged) << "an acknowledged line is unknown";
    EXPECT_GE(report.executed, told.executed);
    EXPECT_LE(report.acknowledged, report.horizon);
    if (report.uncertain) {
      EXPECT_EQ(report.uncertain->first, report.acknowledged + 1);
      EXPECT_EQ(report.uncertain->last, report.horizon);
    }
  }

  void await_extruder_off() {
    ASSERT_TRUE(shop_.wait_until([&] {
      const auto trace = shop_.trace();
      const auto permits = of_kind(trace, "permit");
      return of_kind(trace, "extrude_on").size() == of_kind(trace, "extrude_off").size() &&
             !permits.empty() && permits.back().at("run") == false;
    })) << "filament is still pushed";
  }

  void clear() {
    ASSERT_TRUE(shop_.wait_until([&] {
      const std::string state = shop_.rig_state();
      if (state == "idle") return true;
      if (state == "suspended" || state == "fault") {
        // Refused while the devices are still being asked; then it is tried again.
        EXPECT_TRUE(shop_.try_call(Method::kClear).ok() || shop_.rig_state() != state);
      }
      return false;
    })) << shop_.daemon_log();
  }

  // The job that finishes this one; or nothing, because nothing is left.
  std::optional<std::int64_t> recover(std::int64_t job) {
    auto made = shop_.try_call(Method::kRecover, {{"job", job}});
    if (!made && made.error().sentence.find("half laid") != std::string::npos) {
      ++removed_;
      made = shop_.try_call(Method::kRecover, {{"job", job}, {"bead", "removed"}});
    }
    if (made) return made->at("job").get<std::int64_t>();
    EXPECT_NE(made.error().sentence.find("nothing is"), std::string::npos) << made.error().sentence;
    return std::nullopt;
  }

  // Every bead of the plan was begun once, but for those that were taken off and laid again.
  void judge_beads(std::size_t begin) {
    std::map<Place, int> laid;
    for (const json& record : of_kind(shop_.trace(), "extrude_on", begin)) ++laid[place_of(record)];
    int again = 0;
    std::size_t found = 0;
    for (const auto& [place, times] : laid) {
      if (!expected_.contains(place)) continue;  // a purge beside the part
      ++found;
      again += times - expected_.at(place);
    }
    EXPECT_EQ(found, expected_.size()) << "a bead was left out";
    EXPECT_LE(again, removed_) << "a bead was laid twice";
  }

  Shop shop_;
  std::map<Place, int> expected_;  // where the beads of an undisturbed run begin
  int removed_ = 0;
};

TEST_F(Kills, NothingAcknowledgedIsLostAndNoBeadIsLaidTwiceOrLeftOut) {
  const int kills = number_from("REFORGE_KILLS", 20);
  const int seed = number_from("REFORGE_SEED", 1);
  std::printf("seed %d, %d kills\n", seed, kills);
  std::mt19937 random(static_cast<unsigned>(seed));
  shop_.config["verifier"] = {{"command", {REFORGE_CLI, "verify", "--json"}}, {"limits", nullptr}};
  shop_.config["limits"]["waiting_jobs"] = 1000;
  shop_.start_rig();
  shop_.start_daemon();

  // Undisturbed, for what is expected, and how long it takes.
  std::int64_t job = submit();
  ASSERT_NO_FATAL_FAILURE(start(job));
  const auto began = std::chrono::steady_clock::now();
  ASSERT_TRUE(shop_.wait_for_state(job, JobState::kDone)) << shop_.job(job).reason;
  const std::chrono::duration<double> whole = std::chrono::steady_clock::now() - began;
  for (const json& record : of_kind(shop_.trace(), "extrude_on")) ++expected_[place_of(record)];
  ASSERT_FALSE(expected_.empty());

  std::uniform_real_distribution<double> share(0, 0.4);
  std::size_t begin = shop_.trace().size();
  job = submit();
  int done = 0;
  for (int kill = 0; kill < kills;) {
    ASSERT_NO_FATAL_FAILURE(start(job));
    std::this_thread::sleep_for(whole * share(random));
    const auto told = shop_.job(job);
    bool over = is_over(told.state);
    if (!over) {
      shop_.kill_daemon();
      ++kill;
      ASSERT_NO_FATAL_FAILURE(await_extruder_off());
      shop_.start_daemon();
      judge_interruption(job, told);
      ASSERT_NO_FATAL_FAILURE(clear());
      if (shop_.job(job).state != JobState::kDone) {
        const auto next = recover(job);
        over = !next;
        if (next) job = *next;
      } else {
        over = true;
      }
    } else {
      ASSERT_EQ(told.state, JobState::kDone) << told.reason << shop_.daemon_log();
    }
    if (!over) continue;
    judge_beads(begin);
    ++done;
    removed_ = 0;
    begin = shop_.trace().size();
    job = submit();
  }
  std::printf("%d jobs came to their end on the way\n", done);
}

}  // namespace
}  // namespace reforge
