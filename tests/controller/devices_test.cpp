#include <gtest/gtest.h>

#include <random>

#include "controller/devices/cnc_grbl.h"
#include "controller/devices/cnc_session.h"
#include "controller/devices/extruder_link.h"
#include "tests/controller/support/rig_bench.h"

namespace reforge {
namespace {

using namespace std::chrono_literals;

template <typename T>
T only(const std::vector<CncReport>& reports) {
  EXPECT_EQ(reports.size(), 1u);
  const T* found = reports.empty() ? nullptr : std::get_if<T>(&reports.front());
  EXPECT_NE(found, nullptr);
  return found ? *found : T{};
}

struct Grbl : testing::Test {
  CncGrbl grbl{bench_rig().cnc};
};

TEST_F(Grbl, ReadsAcknowledgementsErrorsAndAlarms) {
  only<cnc::Acknowledged>(grbl.receive("ok\r\n"));
  EXPECT_EQ(only<cnc::Rejected>(grbl.receive("error:20\r\n")).sentence,
            "error:20, a word or code is not supported");
  EXPECT_EQ(only<cnc::Alarm>(grbl.receive("ALARM:3\r\n")).sentence,
            "ALARM:3, reset while in motion; the position is lost: home again");
  EXPECT_EQ(grbl_error_sentence(999), "error:999, a code unknown to us");
  EXPECT_EQ(grbl_error_sentence(-1), "error:-1, a code unknown to us");
}

TEST_F(Grbl, ReadsAStatusOfFiveAxes) {
  const auto status = only<CncStatus>(
      grbl.receive("<Run|MPos:1.500,-2.000,3.000,45.000,90.000|Bf:15,128|FS:500,12000>\r\n"));
  EXPECT_EQ(status.state, CncRunState::kRun);
  EXPECT_EQ(status.axes, 5);
  EXPECT_DOUBLE_EQ(status.machine_position[1], -2.0);
  EXPECT_DOUBLE_EQ(status.machine_position[4], 90.0);
  EXPECT_DOUBLE_EQ(status.feed_mm_per_min, 500);
  EXPECT_DOUBLE_EQ(status.spindle_rpm, 12000);
}

TEST_F(Grbl, TellsAHoldThatIsCompleteFromOneThatIsNot) {
  EXPECT_EQ(only<CncStatus>(grbl.receive("<Hold:0>\r\n")).state, CncRunState::kHeld);
  EXPECT_EQ(only<CncStatus>(grbl.receive("<Hold:1>\r\n")).state, CncRunState::kHolding);
}

TEST_F(Grbl, ReadsIdentityAndOffsets) {
  EXPECT_EQ(only<cnc::Identity>(grbl.receive("[AXS:5:XYZBC]\r\n")).axes, "XYZBC");
  EXPECT_EQ(only<cnc::Identity>(grbl.receive("[OPT:VNMHSL,35,1024,5,0]\r\n")).receive_buffer, 1024);
  const auto g54 = only<cnc::WorkOffset>(grbl.receive("[G54:1.000,2.000,-3.500,0.000,0.000]\r\n"));
  EXPECT_EQ(g54.name, "G54");
  EXPECT_EQ(g54.axes, 5);
  EXPECT_DOUBLE_EQ(g54.offset[2], -3.5);
}

TEST_F(Grbl, WhatIsNotItsLanguageIsGarbage) {
  for (const char* line : {"o\r\n", "okk\r\n", "error:\r\n", "error:2x\r\n", "<Sprint|FS:0,0>\r\n",
                           "<Idle|MPos:1,nan,3>\r\n", "<Idle|MPos:1,2,3,4,5,6,7>\r\n",
                           "[AXS:5]\r\n", "[G54:]\r\n", "<Idle\r\n"}) {
    only<cnc::Garbage>(grbl.receive(line));
  }
}

TEST_F(Grbl, SplitsOfTheStreamDoNotMatter) {
  const std::string text = "ok\r\n<Idle|FS:0,0>\r\nerror:9\r\n\r\n[MSG:hello]\r\nok\r\n";
  const auto whole = grbl.receive(text);
  EXPECT_EQ(whole.size(), 5u);
  std::vector<std::size_t> kinds;
  for (const char c : text) {
    for (const CncReport& report : grbl.receive(std::string(1, c))) kinds.push_back(report.index());
  }
  ASSERT_EQ(kinds.size(), whole.size());
  for (std::size_t i = 0; i < kinds.size(); ++i) EXPECT_EQ(kinds[i], whole[i].index());
}

TEST_F(Grbl, AFloodWithoutALineEndIsDroppedAndTheNextLineRead) {
  EXPECT_TRUE(grbl.receive(std::string(100'000, 'x')).empty());
  const auto reports = grbl.receive("\nok\n");
  ASSERT_EQ(reports.size(), 2u);
  EXPECT_EQ(std::get<cnc::Garbage>(reports[0]).text.size(), 80u);
  EXPECT_TRUE(std::holds_alternative<cnc::Acknowledged>(reports[1]));
}

TEST_F(Grbl, RandomBytesDoNoHarm) {
  std::mt19937 random(3);
  const std::string alphabet = "ok\n\r<>[]|:,.0123456789IdleRunMPosFSG54AXSOPTerror\xff\x18?";
  for (int i = 0; i < 2000; ++i) {
    std::string bytes;
    for (auto n = random() % 60; n > 0; --n) bytes += alphabet[random() % alphabet.size()];
    grbl.receive(bytes);
  }
}

TEST_F(Grbl, RefusesALineWithAByteThatWouldActAtOnce) {
  for (const char* words : {"G1X1!", "G1~", "?", "$H", "G1\x18", "G1\x80", "G1\nG0"}) {
    EXPECT_FALSE(grbl.encode(words, 12).ok()) << words;
  }
  EXPECT_NE(grbl.encode("G1X1!", 12).error().sentence.find("Line 12"), std::string::npos);
  EXPECT_EQ(*grbl.encode("G1X1", 12), "G1X1\n");
}

TEST_F(Grbl, RefusesALineLongerThanTheControllerTakes) {
  EXPECT_TRUE(grbl.encode(std::string(79, 'X'), 1).ok());
  EXPECT_FALSE(grbl.encode(std::string(80, 'X'), 1).ok());
}

TEST(CncSession, IsSilentOnlyAfterItHasSpoken) {
  CncSession session(std::make_unique<CncGrbl>(bench_rig().cnc), {});
  session.opened(0s);
  EXPECT_EQ(session.take_output(), "?");
  for (Instant now = 0s; now < 10s; now += 100ms) EXPECT_TRUE(session.tick(now).empty());
  session.receive(10s, "<Idle>\r\n");
  bool silent = false;
  for (Instant now = 10s; now < 12s; now += 100ms) silent = silent || !session.tick(now).empty();
  EXPECT_TRUE(silent);
}

TEST(CncSession, AnAcknowledgementBelongsToTheOpenQuestion) {
  CncSession session(std::make_unique<CncGrbl>(bench_rig().cnc), {});
  session.opened(0s);
  session.ask(0s, CncSession::Question::kIdentity);
  const auto events = session.receive(1ms, "[VER:1.1f:]\r\n[AXS:5:XYZBC]\r\nok\r\nok\r\n");
  ASSERT_EQ(events.size(), 4u);
  EXPECT_TRUE(std::holds_alternative<CncSession::Answered>(events[2]));
  EXPECT_TRUE(std::holds_alternative<CncReport>(events[3]));
  EXPECT_EQ(session.facts().axes, "XYZBC");
}

// --- the extruder's link against the simulated board, byte by byte through a bad wire

struct Bead : testing::Test {
  Bead() : link(bench_rig(), {}, 9) {}

  void run(Duration time) {
    const Instant end = now + time;
    for (; now < end; now += 5ms) {
      board.advance(now);
      if (now >= link.next_deadline()) take(link.tick(now));
      const std::string out = link.take_output();
      if (!out.empty() && !drops()) board.receive(now, spoilt(out));
      const std::string in = board.take_transmitted();
      if (!in.empty() && !drops()) take(link.receive(now, spoilt(in)));
    }
  }
  bool drops() {
    const bool drop = loss > 0 && random() % 100 < loss;
    dropped += drop;
    return drop;
  }
  std::string spoilt(std::string bytes) {
    if (noise > 0 && random() % 100 < noise) {
      bytes[random() % bytes.size()] ^= static_cast<char>(1 + random() % 255);
    }
    return bytes;
  }
  void take(const std::vector<ExtruderLink::Event>& events) {
    for (const auto& event : events) {
      if (const auto* d = std::get_if<ExtruderLink::Done>(&event)) done.push_back(d->order.m_code);
      if (const auto* r = std::get_if<ExtruderLink::Refused>(&event))
        refused.push_back(r->sentence);
      if (const auto* f = std::get_if<ExtruderLink::Fault>(&event)) faults.push_back(f->sentence);
      if (std::holds_alternative<ExtruderLink::Lost>(event)) ++lost;
    }
  }
  void identify() {
    link.opened(now);
    run(2s);
    ASSERT_TRUE(link.identified());
  }

  ExtruderLink link;
  SimulatedExtruder board;
  Instant now = 1s;
  std::mt19937 random{11};
  unsigned loss = 0, noise = 0;  // percent of transmissions
  std::vector<int> done;
  std::vector<std::string> refused, faults;
  int lost = 0;
  int dropped = 0;
};

TEST_F(Bead, SettingsAreBroughtToTheRigFiles) {
  identify();
  EXPECT_GE(board.orders_heard, 4) << "steps, speed and temperatures differed";
  const int orders = board.orders_heard;
  link.opened(now);
  run(2s);
  EXPECT_TRUE(link.identified());
  EXPECT_EQ(board.orders_heard, orders) << "they agree now";
}

TEST_F(Bead, OrdersAreDoneOnceOverALossyAndNoisyWire) {
  identify();
  loss = noise = 15;
  for (const ExtruderOrder& order :
       {ExtruderOrder{70, 205}, ExtruderOrder{72, 0.3}, ExtruderOrder{73}, ExtruderOrder{74, 1},
        ExtruderOrder{75}, ExtruderOrder{72, 0.3}, ExtruderOrder{73}, ExtruderOrder{74, 1},
        ExtruderOrder{75}, ExtruderOrder{71}}) {
    link.order(now, order);
    for (int i = 0; i < 400 && link.busy(); ++i) run(10ms);
    if (lost > 0) break;
  }
  EXPECT_EQ(lost, 0);
  EXPECT_EQ(done, (std::vector<int>{70, 72, 73, 74, 75, 72, 73, 74, 75, 71}));
  EXPECT_EQ(board.executed.size(), 10u);
  EXPECT_GT(dropped, 5);
}

TEST_F(Bead, M73OvertakesAnM72UnderWay) {
  identify();
  link.order(now, {70, 205});
  run(1s);
  link.order(now, {72, 0.3});
  run(10ms);
  link.order(now, {73});
  run(1s);
  EXPECT_EQ(done, (std::vector<int>{70, 73}));
  EXPECT_FALSE(board.pushes());
  EXPECT_TRUE(refused.empty());
}

TEST_F(Bead, AnOrderNobodyAcknowledgesIsALostLink) {
  identify();
  board.deaf = true;
  link.order(now, {70, 205});
  run(1s);
  EXPECT_EQ(lost, 1);
}

TEST_F(Bead, AnOrderWithoutEndIsRefused) {
  identify();
  link.order(now, {70, 205});
  run(1s);
  board.never_finishes = true;
  link.order(now, {74, 1});
  run(20s);
  ASSERT_EQ(refused.size(), 1u);
  EXPECT_NE(refused[0].find("M74 P1.0000"), std::string::npos);
}

TEST_F(Bead, StarvingLetsTheDeadManActAndThenReportsIt) {
  identify();
  link.order(now, {70, 205});
  run(1s);
  ASSERT_TRUE(board.hot());
  link.starve(now);
  run(3500ms);
  EXPECT_FALSE(board.hot());
  EXPECT_TRUE(faults.empty() || faults.size() == 1);
  run(2s);
  EXPECT_EQ(faults.size(), 1u);
  EXPECT_EQ(lost, 0) << "the silence was ours";
}

TEST_F(Bead, TheHeartbeatKeepsAnExtrudingBoardAlive) {
  identify();
  link.order(now, {70, 205});
  run(1s);
  link.order(now, {72, 0.3});
  run(60s);
  EXPECT_TRUE(board.pushes());
  EXPECT_EQ(lost, 0);
  EXPECT_TRUE(faults.empty());
}

}  // namespace
}  // namespace reforge
