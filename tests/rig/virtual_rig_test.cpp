#include "tools/rig/virtual_rig.h"

#include <gtest/gtest.h>

#include "tests/rig/fake_board.h"
#include "tests/rig/shipped_rig.h"

namespace reforge {
namespace {

using wire::Frame;

struct KeptTrace final : Trace {
  void write(const TraceRecord& record) override { records.push_back(record); }
  std::vector<TraceRecord> of(const std::string& event) const {
    std::vector<TraceRecord> found;
    for (const TraceRecord& record : records) {
      if (record.event == event) found.push_back(record);
    }
    return found;
  }
  std::vector<TraceRecord> records;
};

struct Rig {
  Rig() : rig(shipped_rig(), true, std::make_unique<FakeBoard>(board), &trace) {}
  void advance_to(int64_t ns) {
    while (rig.now_ns() < ns) {
      rig.advance(ns);
      from_cnc += rig.take_for_host(Link::kCnc);
      from_board += rig.take_for_host(Link::kExtruder);
    }
  }
  static std::string bytes(const Frame& frame) {
    uint8_t out[wire::kFrameMax];
    const uint8_t n = wire::encode(frame, out);
    return {reinterpret_cast<const char*>(out), n};
  }
  void order(uint8_t m_code, int32_t argument, uint8_t sequence) {
    rig.host_wrote(Link::kExtruder, bytes(wire::pack(wire::Command{m_code, argument}, sequence)));
  }
  void done(uint8_t sequence, wire::Reason reason = wire::Reason::kNone) {
    board.to_send += bytes(wire::pack(wire::Done{reason, wire::State::kExtruding, 0}, sequence));
  }

  FakeBoardState board;
  KeptTrace trace;
  VirtualRig rig;
  std::string from_cnc, from_board;
};

TEST(UartLine, BytesArriveOneBehindTheOther) {
  UartLine line(10000);  // one byte a millisecond
  line.send("ab", 5 * kNsPerMs);
  EXPECT_EQ(line.next_arrival_ns(), 6 * kNsPerMs);
  EXPECT_EQ(line.take_arrived(6 * kNsPerMs - 1), "");
  EXPECT_EQ(line.take_arrived(6 * kNsPerMs), "a");
  line.send("c", 6 * kNsPerMs);
  EXPECT_EQ(line.take_arrived(8 * kNsPerMs), "bc");
  EXPECT_EQ(line.next_arrival_ns(), kNeverNs);
}

TEST(VirtualRig, ALineTakesItsTimeOnTheWireAndInTheController) {
  Rig rig;
  rig.advance_to(10 * kNsPerMs);
  rig.from_cnc.clear();
  rig.rig.host_wrote(Link::kCnc, std::string(70, ' ') + "\n");  // 71 bytes at 115200: 6.2 ms
  rig.advance_to(16 * kNsPerMs);
  EXPECT_EQ(rig.from_cnc, "");
  rig.advance_to(18 * kNsPerMs);
  EXPECT_EQ(rig.from_cnc, "ok\r\n");
}

TEST(VirtualRig, AdvanceReturnsAtTheMillisecondThatBringsBytes) {
  Rig rig;
  rig.advance_to(10 * kNsPerMs);
  rig.rig.host_wrote(Link::kCnc, "?");
  rig.rig.advance(kNsPerSecond);
  EXPECT_EQ(rig.rig.now_ns(), 11 * kNsPerMs);
  EXPECT_EQ(rig.rig.take_for_host(Link::kCnc).substr(0, 1), "<");
}

TEST(VirtualRig, TheBoardsHoldOutputHoldsTheCnc) {
  Rig rig;
  rig.rig.host_wrote(Link::kCnc, "G91 G1 X-40 F1200\n");
  rig.advance_to(kNsPerSecond);
  EXPECT_EQ(rig.rig.cnc().state_name(), "Run");
  rig.board.permitted = false;
  rig.advance_to(kNsPerSecond + 200 * kNsPerMs);
  EXPECT_EQ(rig.rig.cnc().state_name(), "Hold:0");
  ASSERT_EQ(rig.trace.of("hold").size(), 1u);
  EXPECT_EQ(rig.trace.of("hold")[0].fields["by"], "input");
  EXPECT_EQ(rig.trace.of("held").size(), 1u);
  EXPECT_EQ(rig.trace.of("permit")[0].fields["run"], false);
}

TEST(VirtualRig, ABoardWithoutPermissionAtPowerOnIsNoEdge) {
  FakeBoardState state;
  state.permitted = false;
  VirtualRig rig(shipped_rig(), true, std::make_unique<FakeBoard>(state), nullptr);
  rig.advance(kNsPerMs);
  EXPECT_EQ(rig.cnc().state_name(), "Idle");
}

TEST(VirtualRig, OnlyTheExtrudersDtrResetsTheBoardAndOnlyWhenRising) {
  Rig rig;
  rig.rig.dtr(Link::kCnc, true);
  rig.rig.dtr(Link::kExtruder, false);
  EXPECT_EQ(rig.board.resets, 0);
  rig.rig.dtr(Link::kExtruder, true);
  EXPECT_EQ(rig.board.resets, 1);
  EXPECT_EQ(rig.trace.of("dtr").size(), 3u);
  ASSERT_EQ(rig.trace.of("reset").size(), 1u);
  EXPECT_EQ(rig.trace.of("reset")[0].fields["cause"], "DTR");
}

TEST(VirtualRig, MovesAreTracedWhereTheAxesReallyAre) {
  Rig rig;
  rig.rig.host_wrote(Link::kCnc, "G90 G1 X39.5 F1200\n");
  rig.advance_to(4 * kNsPerSecond);
  ASSERT_EQ(rig.trace.of("move").size(), 1u);
  const TraceRecord move = rig.trace.of("move")[0];
  EXPECT_EQ(move.fields["x"], 39.5);
  EXPECT_EQ(move.fields["z"], 139.0);
  EXPECT_EQ(move.fields["b"], 0.0);
  EXPECT_EQ(move.fields["feed"], 1200.0);
  EXPECT_EQ(move.fields["n"], 1);
  EXPECT_EQ(rig.trace.of("line")[0].fields["text"], "G90G1X39.5F1200");
}

TEST(ExtruderWitness, TheBeadIsBoundedByWhatTheBoardReportsDone) {
  Rig rig;
  rig.order(72, 350, 1);
  rig.advance_to(20 * kNsPerMs);
  for (int i = 0; i < 100; ++i) rig.board.steps.push_back({(21 + i) * kNsPerMs, 1});
  rig.done(1);
  rig.advance_to(130 * kNsPerMs);
  rig.order(73, 0, 2);
  rig.done(2);
  rig.advance_to(300 * kNsPerMs);
  const auto on = rig.trace.of("extrude_on");
  const auto off = rig.trace.of("extrude_off");
  ASSERT_EQ(on.size(), 1u);
  ASSERT_EQ(off.size(), 1u);
  EXPECT_EQ(on[0].fields["filament_mm_per_s"], 0.35);
  EXPECT_EQ(on[0].fields["steps"], 0);
  EXPECT_EQ(off[0].fields["steps"], 100);
  EXPECT_EQ(off[0].fields["by"], "M73");
  EXPECT_TRUE(on[0].fields.contains("x"));
  const auto steps = rig.trace.of("steps");
  ASSERT_EQ(steps.size(), 2u);
  EXPECT_EQ(steps[0].ns, 21 * kNsPerMs);
  EXPECT_EQ(steps[0].fields["moving"], 1);
  EXPECT_EQ(steps[1].ns, 120 * kNsPerMs);
  EXPECT_EQ(steps[1].fields["steps"], 100);
  EXPECT_EQ(steps[1].fields["moving"], 0);
}

TEST(ExtruderWitness, AFaultOrAResetEndsTheBead) {
  Rig rig;
  rig.order(72, 350, 1);
  rig.done(1);
  rig.advance_to(10 * kNsPerMs);
  rig.board.to_send +=
      Rig::bytes(wire::pack(wire::FaultReport{wire::Fault::kSilence, {}, 0, 0}, 0));
  rig.advance_to(20 * kNsPerMs);
  ASSERT_EQ(rig.trace.of("extrude_off").size(), 1u);
  EXPECT_EQ(rig.trace.of("extrude_off")[0].fields["by"], "fault");
  EXPECT_EQ(rig.trace.of("fault").size(), 1u);
  rig.order(72, 0, 2);
  rig.done(2);
  rig.advance_to(30 * kNsPerMs);
  EXPECT_FALSE(rig.trace.of("extrude_on")[1].fields.contains("filament_mm_per_s"));
  rig.rig.dtr(Link::kExtruder, true);
  EXPECT_EQ(rig.trace.of("extrude_off")[1].fields["by"], "reset");
}

TEST(ExtruderWitness, ARefusedOrSupersededOrderChangesNothing) {
  Rig rig;
  rig.order(72, 350, 1);
  rig.done(1, wire::Reason::kSuperseded);
  rig.advance_to(10 * kNsPerMs);
  EXPECT_TRUE(rig.trace.of("extrude_on").empty());
}

}  // namespace
}  // namespace reforge
