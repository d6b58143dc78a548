#include "tools/rig/grbl_controller.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/rig/shipped_rig.h"

namespace reforge {
namespace {

constexpr int64_t kMs = 1'000'000;
constexpr int64_t kSecond = 1'000 * kMs;

// A controller past its banner, with time in the test's hands.
struct Cnc {
  explicit Cnc(bool homed = true) : controller(shipped_rig(), homed) {
    controller.take_transmitted();
  }
  // Sends at once and waits long enough for lines to be read, not executed.
  std::string say(const std::string& bytes, int64_t wait_ns = 20 * kMs) {
    controller.receive(bytes);
    return wait(wait_ns);
  }
  std::string wait(int64_t ns) {
    now += ns;
    controller.advance_to(now);
    return controller.take_transmitted();
  }
  std::string status() { return say("?", 0); }
  // Until nothing more happens; returns the seconds that took.
  double run_out() {
    const int64_t begin = now;
    while (controller.next_event_ns() != kNeverNs) {
      now = std::max(now, controller.next_event_ns());
      controller.advance_to(now);
    }
    return static_cast<double>(now - begin) / 1e9;
  }
  int count(CncEvent::Kind kind) {
    int n = 0;
    for (const CncEvent& e : controller.take_events()) n += e.kind == kind;
    return n;
  }

  GrblController controller;
  int64_t now = 0;
};

TEST(GrblController, TheBannerComesFirst) {
  GrblController controller(shipped_rig());
  EXPECT_EQ(controller.take_transmitted(), "\r\nGrblHAL 1.1f ['$' or '$HELP' for help]\r\n");
}

TEST(GrblController, OkComesBeforeExecution) {
  Cnc cnc;
  EXPECT_EQ(cnc.say("G21 G90 G54\nG1 X0 F600\n"), "ok\r\nok\r\n");
  EXPECT_EQ(cnc.controller.state_name(), "Run");
  EXPECT_GT(cnc.controller.g54_position()[0], 80);
  cnc.run_out();
  EXPECT_EQ(cnc.controller.state_name(), "Idle");
  EXPECT_DOUBLE_EQ(cnc.controller.g54_position()[0], 0);
}

TEST(GrblController, AStatusReportShowsFiveAxes) {
  Cnc cnc;
  EXPECT_EQ(cnc.status(),
            "<Idle|MPos:89.000,59.000,139.000,0.000,0.000|Bf:15,128|FS:0,0|"
            "WCO:0.000,0.000,0.000,0.000,0.000>\r\n");
  EXPECT_EQ(cnc.status(),
            "<Idle|MPos:89.000,59.000,139.000,0.000,0.000|Bf:15,128|FS:0,0|Ov:100,100,100>\r\n");
  EXPECT_EQ(cnc.status(), "<Idle|MPos:89.000,59.000,139.000,0.000,0.000|Bf:15,128|FS:0,0>\r\n");
}

TEST(GrblController, AFeedOverrideActsAtOnceAndOnlyOnFeeds) {
  Cnc cnc;
  cnc.say("G90 G1 X-11 F1200\n", 1'000 * kMs);
  for (int i = 0; i < 5; ++i) cnc.say("\x92", 0);  // 50 %
  const double x = cnc.controller.g54_position()[0];
  cnc.wait(1'000 * kMs);
  // 10 mm/s, and what braking from 20 costs: v^2 / 2a more than at the lower speed.
  EXPECT_NEAR(x - cnc.controller.g54_position()[0], 10 + 0.25, 0.01);
  EXPECT_NE(cnc.status().find("|FS:600,"), std::string::npos);
  EXPECT_EQ(cnc.count(CncEvent::Kind::kOverride), 5);
  const double left = cnc.controller.g54_position()[0] + 11;
  EXPECT_NEAR(cnc.run_out(), left / 10 + 10.0 / 400, 1e-3);
  cnc.say("\x90", 0);
  cnc.say("\x97", 0);  // rapids 25 %
  cnc.say("G0 X39\n", 0);
  EXPECT_NEAR(cnc.run_out(), 0.0004 + 50 / 12.5 + 12.5 / 200, 1e-3);
}

TEST(GrblController, AnOverrideLateInAMoveTakesTheCornersItMust) {
  Cnc cnc;
  cnc.say("G91 G1 X-10 F3000\nX-0.2\nX-0.2\nX-10\n", 30 * kMs);
  cnc.wait(230 * kMs);  // about to enter the short ones at full speed
  for (int i = 0; i < 9; ++i) cnc.say("\x92", 0);
  cnc.run_out();
  EXPECT_NEAR(cnc.controller.g54_position()[0], 89 - 20.4, 1e-9);
}

TEST(GrblController, ADoorHoldsUntilItIsShut) {
  Cnc cnc;
  cnc.say("G90 G1 X0 F1200\n", 1'000 * kMs);
  cnc.controller.press(CncButton::kDoorOpen);
  cnc.wait(500 * kMs);
  EXPECT_EQ(cnc.controller.state_name(), "Door:1");
  cnc.say("~");
  EXPECT_EQ(cnc.controller.state_name(), "Door:1");
  cnc.controller.press(CncButton::kDoorClose);
  EXPECT_EQ(cnc.controller.state_name(), "Door:0");
  cnc.say("~");
  EXPECT_EQ(cnc.controller.state_name(), "Run");
  cnc.run_out();
  EXPECT_EQ(cnc.controller.g54_position()[0], 0);
}

TEST(GrblController, ALongMoveTakesDistanceOverFeedPlusItsRamps) {
  Cnc cnc;
  cnc.say("G90 G1 X39 F1200\n", 0);
  // 50 mm at 20 mm/s; each ramp at 200 mm/s^2 costs v / 2a more than passing through.
  EXPECT_NEAR(cnc.run_out(), 0.0004 + 50.0 / 20 + 20.0 / 200, 1e-6);
}

TEST(GrblController, AShortMoveNeverReachesItsFeed) {
  Cnc cnc;
  cnc.say("G91 G0 X-1\n", 0);
  EXPECT_NEAR(cnc.run_out(), 0.0004 + 2 * std::sqrt(1.0 / 200), 1e-6);
}

TEST(GrblController, StraightContinuationsKeepTheirSpeed) {
  Cnc cnc;
  std::string lines = "G91 G1 F1200\n";
  for (int i = 0; i < 10; ++i) lines += "X-5\n";
  cnc.say(lines, 0);
  EXPECT_NEAR(cnc.run_out(), 0.0008 + 50.0 / 20 + 20.0 / 200, 1e-3);
}

TEST(GrblController, ASharpCornerSlowsDownAndNeverStopsShortOfItsEnd) {
  Cnc cnc;
  cnc.say("G91 G1 F1200\nX-20\nY-20\n", 0);
  const double seconds = cnc.run_out();
  EXPECT_GT(seconds, 40.0 / 20 + 20.0 / 200 + 0.05);
  EXPECT_LT(seconds, 40.0 / 20 + 2 * 20.0 / 200 + 0.002);
  EXPECT_EQ(cnc.controller.position(), (Axes{69, 39, 139, 0, 0}));
}

TEST(GrblController, TheSlowestAxisLimitsARapid) {
  Cnc cnc;
  cnc.say("G0 B90\n", 0);  // 60 deg/s, 180 deg/s^2
  EXPECT_NEAR(cnc.run_out(), 0.0004 + 90.0 / 60 + 60.0 / 180, 1e-6);
}

TEST(GrblController, AFullQueueKeepsLinesInTheReceiveBuffer) {
  Cnc cnc;
  cnc.say("G91 G1 F60\n");
  std::string answers;
  for (int i = 0; i < 20; ++i) answers += cnc.say("X-1\n");
  EXPECT_EQ(std::count(answers.begin(), answers.end(), 'k'), MotionQueue::kCapacity);
  EXPECT_NE(cnc.status().find("|Bf:0,"), std::string::npos);
  EXPECT_EQ(std::count_if(answers.begin(), answers.end(), [](char c) { return c == 'e'; }), 0);
  answers = cnc.wait(2 * kSecond);  // two millimetres later
  EXPECT_GE(std::count(answers.begin(), answers.end(), 'k'), 1);
  cnc.run_out();
  EXPECT_NEAR(cnc.controller.position()[0], 69, 1e-9);
}

TEST(GrblController, OverflowOfTheReceiveBufferLosesBytesAndIsRecorded) {
  Cnc cnc;
  cnc.say("G4 P10\n");  // keeps the line reader
  cnc.controller.receive(std::string(128, ' '));
  EXPECT_EQ(cnc.controller.bytes_lost(), 0);
  cnc.controller.receive("ab");
  EXPECT_EQ(cnc.controller.bytes_lost(), 2);
  EXPECT_EQ(cnc.count(CncEvent::Kind::kFault), 1);
}

TEST(GrblController, RealTimeBytesNeedNoRoom) {
  Cnc cnc;
  cnc.say("G4 P10\n");
  cnc.controller.receive(std::string(128, ' '));
  EXPECT_NE(cnc.status().find("|Bf:15,0|"), std::string::npos);
}

TEST(GrblController, BytesDuringAnEepromWriteAreLost) {
  Cnc cnc;
  EXPECT_EQ(cnc.say("$11=0.02\n", 5 * kMs), "");
  cnc.controller.receive("G0 X0\n");
  EXPECT_EQ(cnc.controller.bytes_lost(), 6);
  EXPECT_EQ(cnc.wait(30 * kMs), "ok\r\n");
  EXPECT_NE(cnc.say("$$\n").find("$11=0.020\r\n"), std::string::npos);
}

TEST(GrblController, ADwellIsAcknowledgedOnlyWhenTheQueueHasRunDry) {
  Cnc cnc;
  EXPECT_EQ(cnc.say("G91 G1 X-20 F600\nG4 P0.01\n", kSecond), "ok\r\n");
  EXPECT_EQ(cnc.wait(kSecond), "");
  EXPECT_EQ(cnc.wait(kSecond), "ok\r\n");
  EXPECT_EQ(cnc.controller.state_name(), "Idle");
}

TEST(GrblController, ADwellLastsItsSeconds) {
  Cnc cnc;
  EXPECT_EQ(cnc.say("G4 P1.5\n", 1499 * kMs), "");
  EXPECT_EQ(cnc.wait(2 * kMs), "ok\r\n");
}

TEST(GrblController, HoldSlowsDownToRestAndResumeGoesOn) {
  Cnc cnc;
  cnc.say("G91 G1 X-40 F1200\nY-40\n", kSecond);
  const double before = cnc.controller.position()[0];
  EXPECT_NE(cnc.say("!?", 0).find("<Hold:1|"), std::string::npos);
  EXPECT_EQ(cnc.say("~", 0), "");  // ignored until at rest
  EXPECT_EQ(cnc.controller.state_name(), "Hold:1");
  cnc.wait(101 * kMs);  // 20 mm/s at 200 mm/s^2
  EXPECT_EQ(cnc.controller.state_name(), "Hold:0");
  EXPECT_NEAR(cnc.controller.position()[0], before - 1.0, 1e-6);
  EXPECT_EQ(cnc.say("G4 P0\n"), "");  // nothing is parsed in Hold
  cnc.say("~", 0);
  EXPECT_EQ(cnc.controller.state_name(), "Run");
  cnc.run_out();
  EXPECT_EQ(cnc.controller.position(), (Axes{49, 19, 139, 0, 0}));
  EXPECT_EQ(cnc.controller.take_transmitted(), "ok\r\n");
}

TEST(GrblController, HoldAcrossABlocksEndStaysOnThePath) {
  Cnc cnc;
  std::string lines = "G91 G1 F1200\n";
  for (int i = 0; i < 14; ++i) lines += "X-0.3\n";
  cnc.say(lines, 150 * kMs);
  const double speed = 20;
  const double before = cnc.controller.position()[0];
  cnc.say("!", kSecond);
  EXPECT_EQ(cnc.controller.state_name(), "Hold:0");
  EXPECT_LT(cnc.controller.position()[0], before - 0.3);
  EXPECT_GE(cnc.controller.position()[0], before - speed * speed / 400 - 1e-6);
  cnc.say("~", 0);
  cnc.run_out();
  EXPECT_NEAR(cnc.controller.position()[0], 89 - 14 * 0.3, 1e-9);
}

TEST(GrblController, AHoldPausesADwell) {
  Cnc cnc;
  cnc.say("G4 P1\n", 500 * kMs);
  EXPECT_EQ(cnc.say("!", 10 * kSecond), "");
  cnc.say("~", 0);
  EXPECT_EQ(cnc.wait(490 * kMs), "");
  EXPECT_EQ(cnc.wait(20 * kMs), "ok\r\n");
}

TEST(GrblController, TheHoldInputHoldsOnItsEdge) {
  Cnc cnc;
  cnc.say("G91 G1 X-40 F1200\n", kSecond);
  cnc.controller.set_hold_input(true);
  cnc.wait(200 * kMs);
  EXPECT_EQ(cnc.controller.state_name(), "Hold:0");
  EXPECT_NE(cnc.status().find("|Pn:H"), std::string::npos);
  cnc.controller.set_hold_input(false);
  EXPECT_EQ(cnc.controller.state_name(), "Hold:0");
  cnc.say("~", 0);
  cnc.run_out();
  EXPECT_EQ(cnc.controller.position()[0], 49);
}

TEST(GrblController, ATargetBeyondTheTravelIsAlarm2AndOnlyAResetIsHeard) {
  Cnc cnc;
  EXPECT_EQ(cnc.say("G90 G1 F1200 X80\nX95\n", 5 * kSecond),
            "ok\r\nALARM:2\r\n[MSG:Reset to continue]\r\n");
  EXPECT_EQ(cnc.say("G0 X0\n"), "");
  EXPECT_NE(cnc.status().find("<Alarm|"), std::string::npos);
  EXPECT_EQ(cnc.say("\x18"),
            "\r\nGrblHAL 1.1f ['$' or '$HELP' for help]\r\n[MSG:'$H'|'$X' to unlock]\r\n");
  EXPECT_EQ(cnc.say("G0 X0\n"), "error:9\r\n");
  EXPECT_EQ(cnc.say("$X\nG0 X0\n"), "[MSG:Caution: Unlocked]\r\nok\r\nok\r\n");
}

TEST(GrblController, RotaryAxesHaveLimitsToo) {
  Cnc cnc;
  EXPECT_NE(cnc.say("G0 B111\n").find("ALARM:2"), std::string::npos);
}

TEST(GrblController, AResetInMotionIsAlarm3AndThePositionIsLost) {
  Cnc cnc;
  cnc.say("G91 G1 X-40 F1200\n", kSecond);
  EXPECT_EQ(cnc.say("\x18"),
            "ALARM:3\r\n\r\nGrblHAL 1.1f ['$' or '$HELP' for help]\r\n"
            "[MSG:'$H'|'$X' to unlock]\r\n");
  EXPECT_NEAR(cnc.controller.physical_position()[0], cnc.controller.position()[0] - 1.0, 1e-6);
  EXPECT_EQ(cnc.say("$H\n", 30 * kSecond), "ok\r\n");
  EXPECT_EQ(cnc.controller.physical_position(), cnc.controller.position());
  EXPECT_EQ(cnc.controller.state_name(), "Idle");
}

TEST(GrblController, AResetAtRestKeepsThePositionAndTheQueueIsGone) {
  Cnc cnc;
  cnc.say("G91 G1 X-40 F1200\nY-40\n", kSecond);
  cnc.say("!", kSecond);
  const Axes here = cnc.controller.position();
  EXPECT_EQ(cnc.say("\x18"), "\r\nGrblHAL 1.1f ['$' or '$HELP' for help]\r\n");
  EXPECT_EQ(cnc.controller.state_name(), "Idle");
  EXPECT_EQ(cnc.controller.position(), here);
  EXPECT_EQ(cnc.run_out(), 0);
}

TEST(GrblController, AnErrorDoesNotFlushWhatFollows) {
  Cnc cnc;
  EXPECT_EQ(cnc.say("G90\nG77\nG91\n"), "ok\r\nerror:20\r\nok\r\n");
}

TEST(GrblController, ErrorsHaveGrblsNumbers) {
  const std::pair<const char*, int> cases[] = {{"M70", 20},
                                               {"M72 P0.3", 20},
                                               {"M75", 20},
                                               {"G2 X1 Y1 I1", 20},
                                               {"A10", 20},
                                               {"5", 1},
                                               {"G", 2},
                                               {"X--1", 2},
                                               {"X1E3", 20},
                                               {"G1 X1", 22},
                                               {"G0 G1 X1 F1", 21},
                                               {"M3 M5", 21},
                                               {"X1 X2", 25},
                                               {"F-1", 4},
                                               {"G4", 28},
                                               {"G10 L2 P1", 26},
                                               {"G10 L2 X1", 28},
                                               {"G0 X1 P3", 36},
                                               {"G80 X1", 31},
                                               {"N0 G0", 27},
                                               {"G10 L2 P9 X0", 29},
                                               {"M3.5", 23},
                                               {"$nope", 3},
                                               {"$J=G91 X1 F100", 3}};
  for (const auto& [line, number] : cases) {
    Cnc cnc;
    EXPECT_EQ(cnc.say(std::string(line) + "\n"), "error:" + std::to_string(number) + "\r\n")
        << line;
  }
}

TEST(GrblController, CommentsBlanksAndEmptyLinesAreAcknowledged) {
  Cnc cnc;
  EXPECT_EQ(cnc.say("; path 1\n( note ) g0 x 88 ; on\n\n"), "ok\r\nok\r\nok\r\n");
  cnc.run_out();
  EXPECT_EQ(cnc.controller.position()[0], 88);
}

TEST(GrblController, LinesOfMoreThan80CharactersAreRefusedWhole) {
  Cnc cnc;
  EXPECT_EQ(cnc.say("G0 X0 ;" + std::string(74, 'x') + "\n"), "error:11\r\n");
  EXPECT_EQ(cnc.controller.state_name(), "Idle");
  EXPECT_EQ(cnc.say("G0 X0 ;" + std::string(73, 'x') + "\n"), "ok\r\n");
}

TEST(GrblController, IncrementalInchAndMachineCoordinates) {
  Cnc cnc;
  cnc.say("G10 L2 P1 X10 Y20 Z30\n", 100 * kMs);
  cnc.say("G0 X0 Y0 Z0\n", 0);
  cnc.run_out();
  EXPECT_EQ(cnc.controller.position(), (Axes{10, 20, 30, 0, 0}));
  cnc.say("G20 G91 G0 X1\n", 0);
  cnc.run_out();
  EXPECT_NEAR(cnc.controller.position()[0], 35.4, 1e-9);
  cnc.say("G21 G90 G53 G0 Z5\n", 0);
  cnc.run_out();
  EXPECT_NEAR(cnc.controller.position()[2], 5, 1e-9);
  EXPECT_NE(cnc.say("$#\n").find("[G54:10.000,20.000,30.000,0.000,0.000]\r\n"), std::string::npos);
}

TEST(GrblController, AnUnhomedMachineIsLockedUntilHomed) {
  Cnc cnc(false);
  EXPECT_EQ(cnc.say("G0 X0\n"), "error:9\r\n");
  EXPECT_EQ(cnc.say("$H\n", 0), "");
  EXPECT_EQ(cnc.wait(60 * kSecond), "ok\r\n");
  EXPECT_EQ(cnc.say("G0 X0\n"), "ok\r\n");
}

TEST(GrblController, TheSpindleChangesOnlyWhenTheQueueHasRunDry) {
  Cnc cnc;
  EXPECT_EQ(cnc.say("G91 G1 X-20 F1200\nM3 S12000\n", 100 * kMs), "ok\r\n");
  cnc.run_out();
  EXPECT_EQ(cnc.controller.take_transmitted(), "ok\r\n");
  EXPECT_EQ(cnc.count(CncEvent::Kind::kSpindle), 1);
  EXPECT_NE(cnc.status().find("|FS:0,12000|"), std::string::npos);
}

TEST(GrblController, ProgramEndRestoresModesAndStopsTheSpindle) {
  Cnc cnc;
  EXPECT_EQ(cnc.say("G91 M3 S9000\nM30\n", 0), "");
  cnc.run_out();
  EXPECT_EQ(cnc.controller.take_transmitted(), "ok\r\n[MSG:Pgm End]\r\nok\r\n");
  EXPECT_NE(cnc.say("$G\n").find("[GC:G1 G54 G17 G21 G90 G94 M5 M9 T0 F0 S9000]"),
            std::string::npos);
}

TEST(GrblController, M0HoldsUntilResumed) {
  Cnc cnc;
  EXPECT_EQ(cnc.say("M0\n"), "");
  EXPECT_EQ(cnc.controller.state_name(), "Hold:0");
  EXPECT_EQ(cnc.say("~"), "ok\r\n");
  EXPECT_EQ(cnc.controller.state_name(), "Idle");
}

TEST(GrblController, TheBuildReportNamesTheAxes) {
  Cnc cnc;
  const std::string report = cnc.say("$I\n");
  EXPECT_NE(report.find("[AXS:5:XYZBC]\r\n"), std::string::npos);
  EXPECT_NE(report.find(",128,5,"), std::string::npos);
}

TEST(GrblController, SplittingTimeDifferentlyChangesNothing) {
  const std::string program = "G91 G1 F900\nX-10\nY-7 Z-3\nG4 P0.1\nG0 Z-20 C90\nX-4\n";
  Cnc whole, split;
  whole.say(program, 0);
  split.say(program, 0);
  whole.wait(5 * kSecond);
  for (int i = 0; i < 5000; ++i) split.wait(kMs);
  const auto a = whole.controller.take_events();
  const auto b = split.controller.take_events();
  ASSERT_EQ(a.size(), b.size());
  for (size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].ns, b[i].ns) << i;
    EXPECT_EQ(a[i].kind, b[i].kind) << i;
  }
}

}  // namespace
}  // namespace reforge
