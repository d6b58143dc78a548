#include "controller/core/streamer.h"

#include <gtest/gtest.h>

#include <deque>
#include <random>

#include "controller/core/recovery.h"
#include "controller/devices/cnc_grbl.h"
#include "tests/controller/support/rig_bench.h"

namespace reforge {
namespace {

struct Stream {
  explicit Stream(std::vector<std::string> lines, StreamerOptions options = {})
      : rig(bench_rig()),
        device(rig.cnc),
        streamer(std::make_shared<TextProgram>(std::move(lines)), device, rig, options) {}

  // Hands over what fits and counts it as the CNC's receiver would.
  std::string pump() {
    Result<std::string> bytes = streamer.pump();
    EXPECT_TRUE(bytes.ok()) << (bytes.ok() ? "" : bytes.error().sentence);
    for (std::size_t from = 0; from < bytes->size();) {
      const std::size_t end = bytes->find('\n', from) + 1;
      receiver.push_back(end - from);
      from = end;
    }
    return *bytes;
  }
  void grant() {
    while (const auto line = streamer.wanted_horizon()) streamer.horizon_durable(*line);
  }
  std::size_t held() const {
    std::size_t bytes = 0;
    for (const std::size_t n : receiver) bytes += n;
    return bytes;
  }
  Streamer::Settled ok() {
    receiver.pop_front();
    return streamer.settle();
  }

  RigDescription rig;
  CncGrbl device;
  Streamer streamer;
  std::deque<std::size_t> receiver;
};

std::vector<std::string> moves(int count) {
  std::vector<std::string> lines = {"G21 G90", "G1 X0 F500"};
  std::mt19937 random(5);
  for (int i = 0; i < count; ++i) {
    std::string line = "G1 X" + std::to_string(i % 90);
    if (random() % 2) line += "." + std::to_string(random() % 1000) + " Y1.5 Z-3.25 B10 C20";
    if (random() % 7 == 0) line += " ; half way";
    lines.push_back(line);
    if (random() % 5 == 0) lines.push_back(random() % 2 ? "" : "; only a comment");
  }
  return lines;
}

TEST(Streamer, TheReceiverNeverOverflowsInAHundredThousandRandomAcknowledgements) {
  Stream s(moves(100'000));
  std::mt19937 random(7);
  LineNumber acknowledged = 0;
  std::size_t peak = 0;
  for (bool more = true; more;) {
    s.grant();
    more = !s.pump().empty() || !s.receiver.empty();
    ASSERT_LE(s.held(), 128u);
    ASSERT_EQ(static_cast<int>(s.held()), s.streamer.unacknowledged_bytes());
    peak = std::max(peak, s.held());
    for (auto n = random() % 6; n > 0 && !s.receiver.empty(); --n) {
      ASSERT_EQ(s.ok(), Streamer::Settled::kLine);
      ASSERT_GT(s.streamer.certainty().acknowledged, acknowledged);
      acknowledged = s.streamer.certainty().acknowledged;
    }
  }
  EXPECT_TRUE(s.streamer.at_end());
  EXPECT_GT(peak, 120u);
}

TEST(Streamer, NothingPassesTheHorizon) {
  StreamerOptions options;
  options.horizon_ahead = 10;
  Stream s(moves(100), options);
  EXPECT_EQ(s.pump(), "");
  EXPECT_EQ(s.streamer.wanted_horizon(), 10);
  EXPECT_EQ(s.streamer.wanted_horizon(), std::nullopt) << "asked once";
  EXPECT_EQ(s.pump(), "") << "asked for is not durable";
  s.streamer.horizon_durable(4);
  s.pump();
  EXPECT_LE(s.streamer.certainty().sent, 4);
  EXPECT_EQ(s.streamer.certainty().horizon, 4);
  s.streamer.horizon_durable(10);
  while (!s.receiver.empty()) s.ok();
  s.pump();
  EXPECT_GT(s.streamer.certainty().sent, 4);
  EXPECT_LE(s.streamer.certainty().sent, 10);
}

TEST(Streamer, TheHorizonIsAskedForBeforeItIsReached) {
  Stream s(moves(2000));
  s.grant();
  for (int i = 0; i < 1500; ++i) {
    s.pump();
    if (!s.receiver.empty()) s.ok();
    const LineNumber left = s.streamer.certainty().horizon - s.streamer.certainty().sent;
    ASSERT_GE(left, 50) << "at line " << s.streamer.certainty().sent;
    s.grant();
  }
}

TEST(Streamer, CommentsAreNotSentAndLinesKeepTheirNumbers) {
  Stream s({"; a", "", "G21 G90 ; millimetres", "G1 X1 F500", "; b", "G1 X2"});
  s.grant();
  EXPECT_EQ(s.pump(), "G21G90\nG1X1F500\nG1X2\n");
  EXPECT_EQ(s.streamer.certainty().sent, 6);
  EXPECT_EQ(s.streamer.next_unacknowledged(), 3);
  s.ok();
  EXPECT_EQ(s.streamer.next_unacknowledged(), 4);
  s.ok();
  EXPECT_EQ(s.streamer.certainty().acknowledged, 5) << "a comment has nothing to acknowledge";
  s.ok();
  EXPECT_EQ(s.streamer.certainty().acknowledged, 6);
  EXPECT_EQ(s.streamer.certainty().executed, 0) << "acknowledged is not executed";
}

TEST(Streamer, StopsAtABarrierUntilItIsPassed) {
  Stream s({"G21 G90", "M70 S200", "G1 X1 F500"});
  s.grant();
  EXPECT_EQ(s.pump(), "G21G90\n");
  ASSERT_TRUE(s.streamer.barrier_ahead());
  EXPECT_EQ(s.streamer.next_line(), 2);
  EXPECT_EQ(s.streamer.barrier_order(), (ExtruderOrder{70, 200}));
  EXPECT_EQ(s.pump(), "");
  s.ok();
  std::string dwell;
  ASSERT_TRUE(s.streamer.pump_drain(dwell));
  EXPECT_EQ(dwell, "G4P0.01\n");
  EXPECT_EQ(s.streamer.settle(), Streamer::Settled::kDrain);
  s.streamer.mark_executed();
  s.streamer.begin_barrier();
  EXPECT_EQ(s.streamer.certainty().sent, 2) << "from here on it may have happened";
  EXPECT_EQ(s.streamer.certainty().acknowledged, 1);
  s.streamer.pass_barrier();
  EXPECT_EQ(s.streamer.certainty().executed, 2);
  EXPECT_EQ(s.pump(), "G1X1F500\n");
}

TEST(Streamer, ABarrierBeyondTheHorizonIsNotAhead) {
  StreamerOptions options;
  options.horizon_ahead = 2;
  Stream s({"G21 G90", "; x", "M70 S200"}, options);
  EXPECT_EQ(s.streamer.wanted_horizon(), 2);
  s.streamer.horizon_durable(2);
  s.pump();
  EXPECT_FALSE(s.streamer.barrier_ahead());
  s.streamer.horizon_durable(*s.streamer.wanted_horizon());
  EXPECT_TRUE(s.streamer.barrier_ahead());
}

TEST(Streamer, InStreamPassesTheCodesOn) {
  StreamerOptions options;
  options.relay = false;
  Stream s({"G21 G90", "M70 S200", "G1 X1 F500"}, options);
  s.grant();
  EXPECT_EQ(s.pump(), "G21G90\nM70S200\nG1X1F500\n");
}

TEST(Streamer, AWindowTheControllerNamesIsKept) {
  Stream s(moves(50));
  s.streamer.limit_window(64);
  s.grant();
  s.pump();
  EXPECT_LE(s.held(), 64u);
  EXPECT_GT(s.held(), 30u);
}

TEST(Streamer, AnAcknowledgementOfNothingIsUnexpected) {
  Stream s({"G21 G90"});
  EXPECT_EQ(s.streamer.settle(), Streamer::Settled::kUnexpected);
}

TEST(Streamer, AFaultyLineIsNamed) {
  Stream s({"G21 G90", "G1 X1 F500", "G2 X1"});
  s.grant();
  Result<std::string> bytes = s.streamer.pump();
  ASSERT_FALSE(bytes.ok());
  EXPECT_NE(bytes.error().sentence.find("3"), std::string::npos) << bytes.error().sentence;
}

TEST(Recovery, NamesTheLinesThatAreUncertain) {
  const LineCertainty after_crash{.executed = 40, .acknowledged = 57, .sent = 0, .horizon = 200};
  const auto maybe_run = unconfirmed_lines(after_crash);
  ASSERT_TRUE(maybe_run);
  EXPECT_EQ(maybe_run->first, 41);
  EXPECT_EQ(maybe_run->last, 57);
  const auto maybe_sent = uncertain_lines(after_crash, false);
  ASSERT_TRUE(maybe_sent);
  EXPECT_EQ(maybe_sent->first, 58);
  EXPECT_EQ(maybe_sent->last, 200);
  EXPECT_EQ(
      interruption_sentence(after_crash, false),
      "Line 57 is the last acknowledged; lines 41 to 57 may not have been executed to the end; "
      "lines 58 to 200 may have been sent and executed.");
}

TEST(Recovery, KnowsWhatWasSentWhenTheDaemonLived) {
  const LineCertainty stopped{.executed = 57, .acknowledged = 57, .sent = 58, .horizon = 200};
  EXPECT_FALSE(unconfirmed_lines(stopped));
  EXPECT_EQ(uncertain_lines(stopped, true)->last, 58);
  EXPECT_EQ(interruption_sentence(stopped, true),
            "Line 57 is the last acknowledged; line 58 was sent and may have been executed.");
}

}  // namespace
}  // namespace reforge
