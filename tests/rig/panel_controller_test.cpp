#include "tools/rig/panel_controller.h"

#include <gtest/gtest.h>

#include "tests/rig/shipped_rig.h"

namespace reforge {
namespace {

constexpr char kXon = 0x11, kXoff = 0x13;

RigDescription panel_rig() {
  auto rig = read_rig(std::string(REFORGE_SOURCE_DIR) + "/config/rigs/mx220-panel.json");
  EXPECT_TRUE(rig) << (rig ? "" : rig.error().sentence);
  return *rig;
}

struct Panel {
  Panel() { panel.take_transmitted(); }
  void run(double seconds) {
    now += static_cast<int64_t>(seconds * 1e9);
    panel.advance_to(now);
    for (CncEvent& event : panel.take_events()) events.push_back(event);
  }
  std::vector<CncEvent> of(CncEvent::Kind kind) const {
    std::vector<CncEvent> found;
    for (const CncEvent& event : events) {
      if (event.kind == kind) found.push_back(event);
    }
    return found;
  }
  PanelController panel{panel_rig()};
  int64_t now = 0;
  std::vector<CncEvent> events;
};

TEST(Panel, RunsWhatStandsBetweenTheTwoPercentSigns) {
  Panel p;
  p.panel.receive(
      "G1 X1 F500\n%\nO1000\n(a comment; with G0)\nN10 G90 G1 X80 F1200\nM30\n%\nX70\n");
  p.run(5);
  EXPECT_EQ(p.of(CncEvent::Kind::kMove).size(), 1u);
  EXPECT_EQ(p.panel.g54_position()[0], 80);
  EXPECT_EQ(p.of(CncEvent::Kind::kEnd).size(), 1u);
  EXPECT_EQ(p.panel.state_name(), "Idle");
  EXPECT_EQ(p.panel.take_transmitted(), "");  // nothing is acknowledged
}

TEST(Panel, StopsTheHostBeforeItsBufferIsFullAndLetsItGoOn) {
  Panel p;
  p.panel.receive("%\nG4 P1000\n");
  int sent = 0;
  std::string said;
  while (said.empty() && sent < 100) {
    p.panel.receive("G1 X80 F60\n");
    ++sent;
    said = p.panel.take_transmitted();
  }
  EXPECT_EQ(said, std::string(1, kXoff));
  EXPECT_LT(sent * 11, 512);
  p.run(1.5);  // the dwell is over; all moves but the first have no length
  EXPECT_EQ(p.panel.take_transmitted(), std::string(1, kXon));
}

TEST(Panel, WhoeverIgnoresXoffGetsAnAlarmAndNotAWord) {
  Panel p;
  p.panel.receive("%\nG4 P9000\n");
  for (int i = 0; i < 60; ++i) p.panel.receive("G1 X80 F60\n");
  EXPECT_EQ(p.panel.state_name(), "Alarm");
  EXPECT_EQ(p.panel.take_transmitted(), std::string(1, kXoff));
  p.panel.press(CncButton::kReset);
  EXPECT_EQ(p.panel.state_name(), "Idle");
  EXPECT_EQ(p.panel.take_transmitted(), std::string(1, kXon));
}

TEST(Panel, AWordItDoesNotKnowEndsTheCycle) {
  for (const char* bad :
       {"G43 H1\n", "M98 P1\n", "; no comment here\n", "G1 X500 F100\n", "G2 X1 Y1\n"}) {
    Panel p;
    p.panel.receive("%\nG1 X80 F1200\n");
    p.panel.receive(bad);
    p.run(6);
    EXPECT_EQ(p.panel.state_name(), "Alarm") << bad;
    EXPECT_FALSE(p.panel.outputs().running) << bad;
    EXPECT_EQ(p.of(CncEvent::Kind::kAlarm).size(), 1u) << bad;
  }
}

TEST(Panel, AnMCodeWaitsForMotionThenForTheBoard) {
  Panel p;
  p.panel.set_ready_input(true);
  p.panel.receive("%\nG1 X80 F1200\nM72\nG1 X79\n");
  p.run(0.3);
  EXPECT_FALSE(p.panel.outputs().extrude);  // 9 mm at 20 mm/s are not over
  EXPECT_TRUE(p.panel.outputs().running);
  p.run(0.3);
  EXPECT_TRUE(p.panel.outputs().extrude);
  Panel q;
  q.panel.set_ready_input(false);
  q.panel.receive("%\nM72\nG1 X79 F1200\n");
  q.run(3);
  EXPECT_TRUE(q.of(CncEvent::Kind::kCustom).empty());
  EXPECT_EQ(q.panel.g54_position()[0], 89);
  q.panel.set_ready_input(true);
  q.run(3);
  EXPECT_EQ(q.of(CncEvent::Kind::kCustom).size(), 1u);
  EXPECT_EQ(q.panel.g54_position()[0], 79);
}

TEST(Panel, AHoldStopsTheRunningOutputAndOnlyItsOperatorGoesOn) {
  Panel p;
  p.panel.receive("%\nG1 X0 F1200\n");
  p.run(1);
  p.panel.set_hold_input(true);
  p.run(1);
  EXPECT_EQ(p.panel.state_name(), "Hold:0");
  EXPECT_FALSE(p.panel.outputs().running);
  p.panel.press(CncButton::kStart);  // the input still holds
  p.run(1);
  EXPECT_EQ(p.panel.state_name(), "Hold:0");
  p.panel.set_hold_input(false);
  p.panel.press(CncButton::kStart);
  p.run(6);
  EXPECT_EQ(p.panel.g54_position()[0], 0);
}

TEST(Panel, DwellsAreMillisecondsAndATemperatureIsNoSpindleSpeed) {
  Panel p;
  p.panel.set_ready_input(true);
  p.panel.receive("%\nM70 S205\nG4 P500\nM3 S6000\n");
  p.run(2);
  ASSERT_EQ(p.of(CncEvent::Kind::kDwell).size(), 1u);
  EXPECT_EQ(p.of(CncEvent::Kind::kDwell)[0].value, 0.5);
  ASSERT_EQ(p.of(CncEvent::Kind::kSpindle).size(), 1u);
  EXPECT_EQ(p.of(CncEvent::Kind::kSpindle)[0].value, 6000);
}

}  // namespace
}  // namespace reforge
