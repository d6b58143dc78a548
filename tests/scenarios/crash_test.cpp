// `kill -9` in mid-job, and what the next daemon finds.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <signal.h>
#include <stdlib.h>
#include <termios.h>
#include <unistd.h>

#include <chrono>
#include <thread>

#include "tests/scenarios/shop.h"

namespace reforge {
namespace {

using api::JobState;
using api::Method;
using nlohmann::json;
using reforge::testing::of_kind;
using reforge::testing::Shop;

// A bead of many short strokes: its end is far away when the daemon dies.
std::string long_bead() {
  std::string out =
      "G21\nG90\nG94\nG17\nG54\nG0 Z100\nM70 S180\nG0 X0 Y0\nG1 Z40 F800\nM72 P0.3466\nG4 P0.1\n";
  for (int i = 0; i < 1500; ++i) {
    out +=
        "G1 X" + std::to_string(i % 2 == 0 ? 2 : 0) + " Y" + std::to_string(i * 0.01) + " F500\n";
  }
  return out + "M73\nG0 Z100\nM71\nM30\n";
}

// A pseudo-terminal whose other end the test holds.
struct Terminal {
  Terminal() : master(posix_openpt(O_RDWR | O_NOCTTY)) {
    EXPECT_EQ(grantpt(master), 0);
    EXPECT_EQ(unlockpt(master), 0);
    char text[64] = {};
    EXPECT_EQ(ptsname_r(master, text, sizeof text), 0);
    name = text;
    slave = open(text, O_RDWR | O_NOCTTY);
    termios raw{};
    tcgetattr(slave, &raw);
    cfmakeraw(&raw);
    tcsetattr(slave, TCSANOW, &raw);
  }
  ~Terminal() {
    close(slave);
    close(master);
  }
  // What arrives within ten seconds, at least one byte of it.
  std::string receive() const {
    pollfd ready{master, POLLIN, 0};
    char bytes[256];
    if (poll(&ready, 1, 10000) != 1) return {};
    const ssize_t n = read(master, bytes, sizeof bytes);
    return n > 0 ? std::string(bytes, static_cast<std::size_t>(n)) : std::string();
  }
  int master;
  int slave;
  std::string name;
};

// Until the rig has written nothing for a while.
void wait_until_quiet(const Shop& shop) {
  std::size_t seen = 0;
  for (int same = 0; same < 15;) {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    std::size_t now = 0;
    for (const json& record : shop.trace()) now += record.at("ev") != "temperature" ? 1u : 0u;
    same = now == seen ? same + 1 : 0;
    seen = now;
  }
}

// The last program line the CNC has taken, from the Y each stroke goes to.
std::int64_t last_line_taken(const std::vector<json>& trace) {
  constexpr std::int64_t kFirstStroke = 11 + 12;  // header, then eleven lines before it
  std::int64_t strokes = 0;
  for (const json& record : of_kind(trace, "line")) {
    if (record.at("text").get<std::string>().ends_with("F500")) ++strokes;
  }
  return kFirstStroke + strokes - 1;
}

class Crash : public ::testing::Test {
 protected:
  void start_bead() {
    shop_.start_rig();
    shop_.start_daemon();
    job_ = shop_.ready_job("bead", long_bead());
    next_ = shop_.ready_job("next", "G21\nG90\nG1 X1 F500\nM30\n");
    ASSERT_TRUE(shop_.wait_until([&] { return shop_.rig_state() == "idle"; }));
    shop_.start(job_);
    ASSERT_TRUE(shop_.wait_until([&] { return shop_.job(job_).acknowledged > 80; }))
        << shop_.daemon_log();
  }

  Shop shop_;
  std::int64_t job_ = 0;
  std::int64_t next_ = 0;
};

TEST_F(Crash, KilledDaemonLeavesNothingRunningAndItsSuccessorKnowsWhatWasSent) {
  ASSERT_NO_FATAL_FAILURE(start_bead());
  const std::int64_t told = shop_.job(job_).acknowledged;
  shop_.kill_daemon();

  // The firmware's dead-man ends the bead; the CNC takes nothing but what it already held.
  ASSERT_TRUE(shop_.wait_until([&] { return !of_kind(shop_.trace(), "extrude_off").empty(); }));
  EXPECT_EQ(of_kind(shop_.trace(), "extrude_off").front().at("by"), "fault");
  wait_until_quiet(shop_);
  const auto before = shop_.trace();
  const std::int64_t taken = last_line_taken(before);
  EXPECT_GE(taken, told);
  EXPECT_LT(taken, 1500);
  EXPECT_EQ(of_kind(before, "permit").back().at("run"), false);

  shop_.start_daemon();
  ASSERT_TRUE(shop_.wait_until([&] { return shop_.rig_state() != "disconnected"; }));
  const auto report = shop_.job(job_);
  EXPECT_EQ(report.state, JobState::kInterrupted);
  EXPECT_NE(report.reason, "");
  EXPECT_GE(report.acknowledged, told);
  EXPECT_LE(report.acknowledged, taken);
  ASSERT_TRUE(report.uncertain.has_value());
  EXPECT_EQ(report.uncertain->first, report.acknowledged + 1);
  EXPECT_EQ(report.uncertain->last, report.horizon);
  EXPECT_LE(taken, report.horizon);
  EXPECT_EQ(shop_.job(next_).state, JobState::kReady);
  EXPECT_EQ(shop_.call(Method::kStatus).at("queue"), json{next_});

  // Nothing else moves, and nothing is started before somebody has looked at the rig.
  EXPECT_FALSE(shop_.try_call(Method::kStart, {{"job", next_}}).ok());
  wait_until_quiet(shop_);
  const auto after = shop_.trace();
  for (const char* kind : {"move", "extrude_on", "module", "retract"}) {
    EXPECT_TRUE(of_kind(after, kind, before.size()).empty()) << kind;
  }
  EXPECT_EQ(last_line_taken(after), taken);
  // The port was opened without a reset of the board.
  EXPECT_EQ(of_kind(after, "reset", before.size()).size(), 0u);
}

TEST_F(Crash, FirstByteOfTheSuccessorIsAHold) {
  ASSERT_NO_FATAL_FAILURE(start_bead());
  // The second time nobody has cleared the rig since: the same again.
  for (int i = 0; i < 2; ++i) {
    shop_.kill_daemon();
    const Terminal cnc, extruder;
    shop_.config["clock"] = "monotonic";
    shop_.config["ports"]["cnc"]["path"] = cnc.name;
    shop_.config["ports"]["extruder"]["path"] = extruder.name;
    shop_.start_daemon();
    const std::string first = cnc.receive();
    ASSERT_FALSE(first.empty());
    EXPECT_EQ(first.front(), '!');
    // Then only questions: nothing that could move anything.
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    for (const char byte : first + cnc.receive()) EXPECT_TRUE(byte == '!' || byte == '?') << byte;
    EXPECT_EQ(shop_.job(job_).state, JobState::kInterrupted);
  }
}

}  // namespace
}  // namespace reforge
