// A job from its submission to its end, by the real daemon on the real virtual rig.
#include <gtest/gtest.h>
#include <signal.h>

#include <sstream>

#include "tests/scenarios/shop.h"
#include "tests/support/job_folder.h"

namespace reforge {
namespace {

using api::JobState;
using api::Method;
using nlohmann::json;
using reforge::testing::make_job;
using reforge::testing::of_kind;
using reforge::testing::Shop;
using reforge::testing::write_file;

std::string zigzag(int strokes, double step, const char* feed) {
  std::string out;
  for (int i = 0; i < strokes; ++i) {
    out += "G1 X" + std::to_string(i % 2 == 0 ? 5 : 0) + " Y" + std::to_string(step * i) + " F" +
           feed + "\n";
  }
  return out;
}

const char* const kBegin = "G21\nG90\nG94\nG17\nG54\n";

std::string milling(int strokes) {
  return std::string(kBegin) + "; block 01 mill direction 0 0 1\nG0 Z100\nM3 S12000\nG4 P2\n" +
         "; path 1\nG0 X0 Y0\nG1 Z50 F800\n" + zigzag(strokes, 0.1, "1500") + "G0 Z100\nM5\nM30\n";
}

std::string printing(int strokes) {
  return std::string(kBegin) + "; block 01 print direction 0 0 1\nG0 Z100\nM70 S180\n" +
         "; path 1\nG0 X0 Y0\nG1 Z40 F800\nM72 P0.3466\nG4 P0.1\n" + zigzag(strokes, 0.1, "500") +
         "M73\nG1 X2 F500\nM74 P1.0\nM75\nG0 Z100\nM71\nM30\n";
}

// What the CNC has executed, our own questions and drains apart.
std::vector<std::string> executed_words(const std::vector<json>& trace) {
  std::vector<std::string> out;
  for (const json& record : of_kind(trace, "line")) {
    const auto text = record.at("text").get<std::string>();
    if (text != "G4P0.01" && text.front() != '$') out.push_back(text);
  }
  return out;
}

std::vector<std::string> words_for_the_cnc(const std::string& program) {
  std::vector<std::string> out;
  std::istringstream lines(program);
  for (std::string line; std::getline(lines, line);) {
    std::erase(line, ' ');
    if (line.empty() || line.front() == ';' || line.starts_with("M7")) continue;
    out.push_back(line);
  }
  return out;
}

TEST(Run, MillingAndPrintingComeToTheirEndLineByLine) {
  Shop shop;
  shop.start_rig();
  shop.start_daemon();
  const std::string program = printing(30);
  const auto job = shop.ready_job("tiny", program);
  ASSERT_TRUE(shop.wait_until([&] { return shop.rig_state() == "idle"; })) << shop.daemon_log();
  shop.start(job);
  ASSERT_TRUE(shop.wait_until([&] { return is_over(shop.job(job).state); }));
  const auto report = shop.job(job);
  ASSERT_EQ(report.state, JobState::kDone) << report.reason << shop.daemon_log();
  EXPECT_EQ(report.acknowledged, report.lines);
  EXPECT_EQ(report.executed, report.lines);
  EXPECT_EQ(report.toggles, 6);  // M70 M72 M73 M74 M75 M71
  EXPECT_EQ(report.uncertain, std::nullopt);
  EXPECT_GT(report.machine_s, 10);

  shop.daemon().send_signal(SIGTERM);
  EXPECT_EQ(shop.daemon().end_within(60), 0);
  EXPECT_EQ(executed_words(shop.trace()), words_for_the_cnc(program));
  EXPECT_EQ(of_kind(shop.trace(), "extrude_on").size(), 1u);
  EXPECT_EQ(of_kind(shop.trace(), "extrude_off").front().at("by"), "M73");
}

TEST(Run, HoldStopsTheMotionAndResumeGoesOn) {
  Shop shop;
  shop.start_rig();
  shop.start_daemon();
  const std::string program = milling(300);
  const auto job = shop.ready_job("tiny", program);
  ASSERT_TRUE(shop.wait_until([&] { return shop.rig_state() == "idle"; }));
  EXPECT_FALSE(shop.try_call(Method::kResume).ok());
  shop.start(job);
  ASSERT_TRUE(shop.wait_until([&] { return shop.job(job).acknowledged > 40; }));
  shop.call(Method::kHold);
  ASSERT_TRUE(shop.wait_for_state(job, JobState::kHeld)) << shop.daemon_log();
  EXPECT_FALSE(of_kind(shop.trace(), "held").empty());
  shop.call(Method::kResume);
  ASSERT_TRUE(shop.wait_until([&] { return is_over(shop.job(job).state); }));
  EXPECT_EQ(shop.job(job).state, JobState::kDone) << shop.job(job).reason;
  EXPECT_EQ(executed_words(shop.trace()), words_for_the_cnc(program));
}

TEST(Run, AbortEndsTheJobAndTheNextOneRuns) {
  Shop shop;
  shop.start_rig();
  shop.start_daemon();
  const auto first = shop.ready_job("first", milling(2000));
  const auto second = shop.ready_job("second", milling(5));
  ASSERT_TRUE(shop.wait_until([&] { return shop.rig_state() == "idle"; }));
  shop.start(first);
  EXPECT_FALSE(shop.try_call(Method::kStart, {{"job", second}}).ok());
  ASSERT_TRUE(shop.wait_until([&] { return shop.job(first).acknowledged > 40; }));
  shop.call(Method::kAbort, {{"job", first}});
  ASSERT_TRUE(shop.wait_for_state(first, JobState::kAborted)) << shop.daemon_log();
  EXPECT_LT(shop.job(first).acknowledged, shop.job(first).lines);
  ASSERT_TRUE(shop.wait_until([&] { return shop.rig_state() == "idle"; })) << shop.daemon_log();
  shop.start(second);
  ASSERT_TRUE(shop.wait_until([&] { return is_over(shop.job(second).state); }));
  EXPECT_EQ(shop.job(second).state, JobState::kDone) << shop.job(second).reason;
}

TEST(Run, EndOfTheDaemonHoldsTheMachine) {
  Shop shop;
  shop.start_rig();
  shop.start_daemon();
  const auto job = shop.ready_job("tiny", milling(2000));
  ASSERT_TRUE(shop.wait_until([&] { return shop.rig_state() == "idle"; }));
  shop.start(job);
  ASSERT_TRUE(shop.wait_until([&] { return shop.job(job).acknowledged > 40; }));
  shop.daemon().send_signal(SIGTERM);
  EXPECT_EQ(shop.daemon().end_within(60), 0);
  ASSERT_TRUE(shop.wait_until([&] { return !of_kind(shop.trace(), "held").empty(); }));
  EXPECT_EQ(of_kind(shop.trace(), "hold").front().at("by"), "host");
}

TEST(Submission, VerifierThatFailsKeepsTheJobFromRunning) {
  Shop shop;
  shop.config["verifier"]["command"] = {"/bin/false"};
  shop.start_rig();
  shop.start_daemon();
  make_job(shop.folder() / "bad", milling(5));
  const auto job = shop.call(Method::kSubmit, {{"path", (shop.folder() / "bad").string()}})
                       .at("job")
                       .get<std::int64_t>();
  ASSERT_TRUE(shop.wait_for_state(job, JobState::kFailed));
  const auto started = shop.try_call(Method::kStart, {{"job", job}});
  ASSERT_FALSE(started.ok());
  EXPECT_EQ(started.error().code, Code::kRefused);
}

TEST(Submission, VerifierThatHangsIsEnded) {
  Shop shop;
  shop.config["verifier"] = {{"command", {"/bin/sh", "-c", "sleep 1000"}},
                             {"limits", {{"memory_mib", 1024}, {"seconds", 1}}}};
  shop.start_rig();
  shop.start_daemon();
  make_job(shop.folder() / "slow", milling(5));
  const auto job = shop.call(Method::kSubmit, {{"path", (shop.folder() / "slow").string()}})
                       .at("job")
                       .get<std::int64_t>();
  ASSERT_TRUE(shop.wait_for_state(job, JobState::kFailed));
  EXPECT_NE(shop.job(job).reason.find("too long"), std::string::npos) << shop.job(job).reason;
}

TEST(Submission, WhatHappensToTheFolderAfterwardsChangesNothing) {
  Shop shop;
  shop.start_rig();
  shop.start_daemon();
  const std::string program = milling(5);
  const auto job = shop.ready_job("tiny", program);
  write_file(shop.folder() / "tiny/program.nc", "G0 Z-100\n");
  ASSERT_TRUE(shop.wait_until([&] { return shop.rig_state() == "idle"; }));
  shop.start(job);
  ASSERT_TRUE(shop.wait_until([&] { return is_over(shop.job(job).state); }));
  EXPECT_EQ(executed_words(shop.trace()), words_for_the_cnc(program));

  // Submitted again it does not match its certificate.
  const auto again = shop.try_call(Method::kSubmit, {{"path", (shop.folder() / "tiny").string()}});
  ASSERT_FALSE(again.ok());
  EXPECT_EQ(again.error().code, Code::kHashMismatch);
}

}  // namespace
}  // namespace reforge
