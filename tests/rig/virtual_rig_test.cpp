#include "tools/rig/virtual_rig.h"

#include <gtest/gtest.h>

#include "tests/rig/fake_board.h"
#include "tests/rig/shipped_rig.h"
#include "tools/rig/avr_extruder.h"
#include "tools/rig/board_memory.h"

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

RigScript script_of(const char* text) {
  auto script = RigScript::parse(text, "script");
  EXPECT_TRUE(script) << (script ? "" : script.error().sentence);
  return *script;
}

TEST(VirtualRig, AScriptSpoilsALinkPressesButtonsAndUpsetsTheBoard) {
  FakeBoardState board;
  KeptTrace trace;
  VirtualRig rig(shipped_rig(), true, std::make_unique<FakeBoard>(board), &trace,
                 script_of("at 0.1 cnc to-device drop 2\n"
                           "on move 1 +0.2 panel hold\n"
                           "at 0.5 board brown-out\n"
                           "at 0.6 extruder to-device stall 0.3\n"
                           "at 0.7 extruder unplug 1\n"));
  const auto advance_to = [&](int64_t ns) {
    std::vector<RigAction> ports;
    while (rig.now_ns() < ns) {
      rig.advance(ns);
      for (const Link link : kLinks) rig.take_for_host(link);
      for (const RigAction& action : rig.take_port_actions()) ports.push_back(action);
    }
    return ports;
  };
  advance_to(150 * kNsPerMs);
  rig.host_wrote(Link::kCnc, "xxG1 X88 F1200\nX0\n");
  advance_to(500 * kNsPerMs);
  EXPECT_EQ(trace.of("move").size(), 1u);
  advance_to(610 * kNsPerMs);
  EXPECT_EQ(rig.cnc().state_name(), "Hold:0");
  ASSERT_EQ(board.suffered.size(), 1u);
  EXPECT_EQ(board.suffered[0], BoardMishap::kBrownOut);
  EXPECT_EQ(trace.of("reset")[0].fields["cause"], "brown-out");
  rig.host_wrote(Link::kExtruder, "late");
  const auto ports = advance_to(880 * kNsPerMs);
  EXPECT_EQ(board.received, "");
  ASSERT_EQ(ports.size(), 1u);
  EXPECT_EQ(ports[0].kind, RigAction::Kind::kUnplug);
  advance_to(910 * kNsPerMs);
  EXPECT_EQ(board.received, "late");
  EXPECT_EQ(trace.of("script").size(), 5u);
}

TEST(VirtualRig, FilamentThatStandsIsTracedWhereItsLastStepWas) {
  Rig rig;
  rig.rig.host_wrote(Link::kCnc, "G90 G1 X59 F1200\n");
  rig.board.steps = {{300 * kNsPerMs, 1}, {310 * kNsPerMs, 1}};
  rig.advance_to(kNsPerSecond);
  const auto steps = rig.trace.of("steps");
  ASSERT_EQ(steps.size(), 2u);
  EXPECT_EQ(steps[1].fields["moving"], 0);
  const double moved = steps[0].fields["x"].get<double>() - steps[1].fields["x"].get<double>();
  EXPECT_NEAR(moved, 0.2, 0.021);  // 10 ms at 20 mm/s
}

// The paper's own wiring: M70-M75 executed by the panel, with the real firmware.
TEST(VirtualRig, InStreamTheCncsOutputsWorkTheBoard) {
  auto rig_file = read_rig(std::string(REFORGE_SOURCE_DIR) + "/config/rigs/mx220-panel.json");
  ASSERT_TRUE(rig_file);
  auto avr = AvrBoard::open(REFORGE_FIRMWARE_ELF);
  ASSERT_TRUE(avr);
  AvrBoard& board = **avr;
  board.hot_end().set_temperature(204);
  board.set_memory(commissioned_memory(*rig_file));
  KeptTrace trace;
  VirtualRig rig(*rig_file, true, std::make_unique<AvrExtruder>(std::move(*avr)), &trace);
  const auto advance = [&](double seconds) {
    const int64_t end = rig.now_ns() + static_cast<int64_t>(seconds * 1e9);
    while (rig.now_ns() < end) {
      rig.advance(end);
      for (const Link link : kLinks) rig.take_for_host(link);
    }
  };
  advance(0.3);
  rig.host_wrote(Link::kCnc,
                 "%\nO1\nM70\nG90 G0 X10\nM72\nG4 P100\nG1 X30 F500\nM73\nM74\nM75\nM71\nM30\n%\n");
  for (int i = 0; i < 60 && trace.of("end").empty(); ++i) advance(1);
  ASSERT_EQ(trace.of("end").size(), 1u);
  EXPECT_TRUE(trace.of("fault").empty());
  ASSERT_EQ(trace.of("extrude_on").size(), 1u);
  ASSERT_EQ(trace.of("extrude_off").size(), 1u);
  ASSERT_EQ(trace.of("module").size(), 2u);
  EXPECT_EQ(trace.of("retract").size(), 2u);
  // The bead lies from 10 to 30, and along it filament and tool go together.
  EXPECT_NEAR(trace.of("extrude_on")[0].fields["x"].get<double>(), 10, 0.01);
  EXPECT_NEAR(trace.of("extrude_off")[0].fields["x"].get<double>(), 30, 0.01);
  const double begun = trace.of("extrude_on")[0].fields["steps"].get<double>();
  int compared = 0;
  for (const TraceRecord& flow : trace.of("flow")) {
    const double x = flow.fields["x"].get<double>();
    if (x < 12 || x > 28) continue;
    // 0.347 mm/s x 420 steps/mm; a dwell of 0.1 s, and what the M-code waits after it was done.
    const double seconds = (x - 10) / (500.0 / 60) + 0.1 + 0.02;
    EXPECT_NEAR(flow.fields["steps"].get<double>() - begun, seconds * 0.347 * 420, 8) << x;
    ++compared;
  }
  EXPECT_GT(compared, 80);
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
