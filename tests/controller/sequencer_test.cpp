#include "controller/core/sequencer.h"

#include <gtest/gtest.h>

#include "tests/controller/support/rig_bench.h"

namespace reforge {
namespace {

using namespace std::chrono_literals;
using Words = std::vector<std::string>;

bool in_order(const Words& events, const Words& wanted) {
  auto at = events.begin();
  for (const std::string& word : wanted) {
    at = std::find(at, events.end(), word);
    if (at == events.end()) return false;
    ++at;
  }
  return true;
}

// Runs a printing job until it deposits, for the tests that disturb it there.
void start_depositing(RigBench& bench, int mm = 60) {
  bench.plug_both();
  ASSERT_TRUE(bench.start(bench_program(printing(mm)))) << bench.refusal;
  ASSERT_TRUE(bench.run_until(
      [&] { return bench.core.snapshot().depositing && bench.cnc->state_name() == "Run"; }));
  bench.run_for(400ms);
  ASSERT_TRUE(bench.core.snapshot().depositing);
}

void start_milling(RigBench& bench, int moves = 400) {
  bench.plug_both();
  ASSERT_TRUE(bench.start(bench_program(milling(moves)))) << bench.refusal;
  ASSERT_TRUE(bench.run_until([&] { return bench.cnc->state_name() == "Run"; }));
  bench.run_for(1s);
}

TEST(Sequencer, IdentifiesBothDevicesBeforeTheRigIsIdle) {
  RigBench bench;
  EXPECT_EQ(bench.state(), RigState::kDisconnected);
  bench.plug(Link::kCnc);
  EXPECT_EQ(bench.state(), RigState::kDisconnected);
  bench.plug(Link::kExtruder);
  ASSERT_TRUE(bench.run_until([&] { return bench.state() == RigState::kIdle; }, 5s));
  EXPECT_NE(bench.cnc_bytes.find("$I\n"), std::string::npos);
}

TEST(Sequencer, RunsAMillingJobToItsEnd) {
  RigBench bench;
  bench.plug_both();
  ASSERT_TRUE(bench.start(bench_program(milling(300))));
  ASSERT_TRUE(bench.run_to_end());
  EXPECT_EQ(bench.job_state(), JobState::kDone) << bench.job_sentence();
  EXPECT_EQ(bench.state(), RigState::kIdle);
  const LineCertainty& end = bench.jobs.back().certainty;
  EXPECT_EQ(end.executed, bench.lines_total);
  EXPECT_EQ(end.horizon, bench.lines_total);
  EXPECT_LE(bench.cnc->unanswered_peak(), 128);
  EXPECT_GT(bench.cnc->unanswered_peak(), 100) << "the buffer was never kept full";
}

TEST(Sequencer, RelaysTheCodesInOrderEachAfterADrain) {
  RigBench bench;
  bench.plug_both();
  ASSERT_TRUE(bench.start(bench_program(printing())));
  ASSERT_TRUE(bench.run_to_end());
  EXPECT_EQ(bench.job_state(), JobState::kDone) << bench.job_sentence();
  EXPECT_EQ(bench.m_codes(), (std::vector<int>{70, 72, 73, 74, 75, 72, 73, 74, 75, 71}));
  EXPECT_EQ(bench.extruder.executed[0].argument, 2050);
  EXPECT_EQ(bench.extruder.executed[1].argument, 347);
  EXPECT_EQ(bench.extruder.executed[3].argument, 1000);
  // Each code left the daemon behind a drain's dwell and at a moment when nothing moved.
  for (const auto& executed : bench.extruder.executed) {
    bool moving = false;
    for (const CncEvent& event : bench.cnc_log) {
      if (event.ns > executed.at.count()) break;
      if (event.kind == CncEvent::Kind::kLine && event.text[0] == 'G') moving = true;
      if (event.kind == CncEvent::Kind::kDwell) moving = false;
    }
    EXPECT_FALSE(moving) << "M" << executed.m_code;
  }
}

TEST(Sequencer, RefusesARigThatIsNotCommissionedOnRealPorts) {
  RigBench bench{CoreOptions{}};
  bench.plug_both();
  EXPECT_FALSE(bench.start(bench_program(milling(3))));
  EXPECT_NE(bench.refusal.find("not commissioned"), std::string::npos);
}

TEST(Sequencer, RefusesAPaperCertificateOnRealPorts) {
  RigDescription rig = bench_rig();
  rig.commissioned = Commissioning{"someone", "2024-01-01", ""};
  RigBench bench{CoreOptions{}, rig};
  bench.plug_both();
  EXPECT_FALSE(bench.start(bench_program(milling(3)), Mode::kPaper));
  EXPECT_NE(bench.refusal.find("paper"), std::string::npos);
  EXPECT_TRUE(bench.start(bench_program(milling(3)), Mode::kStrict)) << bench.refusal;
}

TEST(Sequencer, AG54ThatDiffersStartsNothing) {
  RigBench bench;
  bench.plug_both();
  ASSERT_TRUE(bench.start(bench_program(milling(3), "X0.000 Y0.060 Z0.000")));
  bench.run_for(1s);
  ASSERT_EQ(bench.job_state(), JobState::kReady);
  EXPECT_NE(bench.job_sentence().find("G54"), std::string::npos);
  EXPECT_EQ(bench.cnc_bytes.find("M3"), std::string::npos);
  EXPECT_EQ(bench.state(), RigState::kIdle);
  RigBench near;
  near.plug_both();
  ASSERT_TRUE(near.start(bench_program(milling(3), "X0.000 Y0.040 Z0.000")));
  ASSERT_TRUE(near.run_to_end());
  EXPECT_EQ(near.job_state(), JobState::kDone);
}

TEST(Sequencer, AProgramThatExtrudesBeforeM70Fails) {
  RigBench bench;
  bench.plug_both();
  ASSERT_TRUE(bench.start(bench_program({"G0 X0 Y0 Z20", "M72 P0.3"})));
  ASSERT_TRUE(bench.run_to_end());
  EXPECT_EQ(bench.job_state(), JobState::kFailed);
  EXPECT_NE(bench.job_sentence().find("M72 before M70"), std::string::npos);
  EXPECT_TRUE(std::ranges::count(bench.m_codes(), 72) == 0);
}

TEST(Sequencer, HoldAndResumeInMillingKeepEveryLine) {
  RigBench bench;
  start_milling(bench);
  ASSERT_TRUE(bench.order(HoldOrder{}).ok());
  EXPECT_EQ(bench.order_of_events.back(), "!");
  EXPECT_TRUE(std::ranges::count(bench.order_of_events, "M73") == 0);
  ASSERT_TRUE(bench.run_until([&] { return bench.state() == RigState::kHeld; }, 3s));
  EXPECT_EQ(bench.job_state(), JobState::kHeld);
  const std::size_t sent = bench.cnc_bytes.find_last_of('\n');
  bench.run_for(30s);
  EXPECT_EQ(bench.cnc_bytes.find_last_of('\n'), sent) << "lines were sent while held";
  ASSERT_TRUE(bench.order(ResumeOrder{}).ok());
  ASSERT_TRUE(bench.run_to_end());
  EXPECT_EQ(bench.job_state(), JobState::kDone) << bench.job_sentence();
  EXPECT_EQ(bench.jobs.back().certainty.executed, bench.lines_total);
}

TEST(Sequencer, AHoldInMidBeadStopsExtrusionBeforeTheHoldAndAsksForInspection) {
  RigBench bench;
  start_depositing(bench);
  ASSERT_TRUE(bench.order(HoldOrder{}).ok());
  EXPECT_TRUE(in_order(bench.order_of_events, {"M72", "M73", "!"}));
  EXPECT_FALSE(bench.extruder.pushes());
  ASSERT_TRUE(bench.run_until([&] { return bench.state() == RigState::kHeld; }, 3s));
  const Status plain = bench.order(ResumeOrder{});
  ASSERT_FALSE(plain.ok());
  EXPECT_NE(plain.error().sentence.find("inspected"), std::string::npos);
  bench.order_of_events.clear();
  ASSERT_TRUE(bench.order(ResumeOrder{.bead_inspected = true}).ok());
  ASSERT_TRUE(bench.run_to_end());
  EXPECT_EQ(bench.job_state(), JobState::kDone) << bench.job_sentence();
  EXPECT_TRUE(in_order(bench.order_of_events, {"M72", "~", "M73"}));
  EXPECT_EQ(bench.order_of_events.front(), "M72") << "motion before extrusion was restored";
}

TEST(Sequencer, AHoldWhileHeatingLetsItHeatAndGoesOnAfterwards) {
  RigBench bench;
  bench.plug_both();
  ASSERT_TRUE(bench.start(bench_program(printing())));
  ASSERT_TRUE(bench.run_until([&] { return bench.extruder.state == wire::State::kOpening; }));
  ASSERT_TRUE(bench.order(HoldOrder{}).ok());
  bench.run_for(3s);
  EXPECT_EQ(bench.state(), RigState::kHeld);
  EXPECT_EQ(bench.extruder.state, wire::State::kReady);
  ASSERT_TRUE(bench.order(ResumeOrder{}).ok());
  ASSERT_TRUE(bench.run_to_end());
  EXPECT_EQ(bench.job_state(), JobState::kDone) << bench.job_sentence();
  EXPECT_EQ(std::ranges::count(bench.m_codes(), 70), 1);
}

TEST(Sequencer, AHoldBetweenM72AndItsDoneGivesM72Again) {
  RigBench bench;
  bench.plug_both();
  ASSERT_TRUE(bench.start(bench_program(printing())));
  ASSERT_TRUE(bench.run_until([&] { return bench.extruder.state == wire::State::kRestoring; }));
  ASSERT_TRUE(bench.order(HoldOrder{}).ok());
  EXPECT_FALSE(bench.extruder.pushes());
  bench.run_for(2s);
  ASSERT_TRUE(bench.order(ResumeOrder{}).ok()) << "no bead has begun";
  ASSERT_TRUE(bench.run_to_end());
  EXPECT_EQ(bench.job_state(), JobState::kDone) << bench.job_sentence();
  EXPECT_EQ(bench.m_codes(), (std::vector<int>{70, 72, 73, 72, 73, 74, 75, 72, 73, 74, 75, 71}));
}

TEST(Sequencer, AbortHoldsComesToRestAndOnlyThenResets) {
  RigBench bench;
  start_depositing(bench);
  bench.order_of_events.clear();
  ASSERT_TRUE(bench.order(AbortOrder{}).ok());
  EXPECT_FALSE(bench.order(AbortOrder{}).ok());
  EXPECT_EQ(bench.order_of_events, (Words{"M73", "!"}));
  ASSERT_TRUE(bench.run_to_end());
  EXPECT_EQ(bench.job_state(), JobState::kAborted);
  EXPECT_TRUE(in_order(bench.order_of_events, {"M73", "!", "reset"}));
  EXPECT_TRUE(std::ranges::none_of(bench.cnc_log, [](const CncEvent& e) {
    return e.kind == CncEvent::Kind::kAlarm;
  })) << "the CNC was reset in motion";
  EXPECT_NE(bench.job_sentence().find("last acknowledged"), std::string::npos);
  bench.run_for(10s);
  EXPECT_FALSE(bench.extruder.hot());
  EXPECT_TRUE(std::ranges::count(bench.m_codes(), 71) == 0) << "the nozzle stood at the part";
  // The dead-man has latched: the operator looks, clears with leave to retreat, and may start
  // again.
  EXPECT_EQ(bench.state(), RigState::kFault);
  EXPECT_FALSE(bench.order(StartOrder{JobOrder{JobId{7}, "", Mode::kStrict, nullptr}}).ok());
  ASSERT_TRUE(bench.order(ClearOrder{.module_may_retreat = true}).ok());
  ASSERT_TRUE(bench.run_until([&] { return bench.state() == RigState::kIdle; }, 10s));
  ASSERT_TRUE(bench.start(bench_program(printing())));
  ASSERT_TRUE(bench.run_to_end());
  EXPECT_EQ(bench.job_state(), JobState::kDone) << bench.job_sentence();
}

TEST(Sequencer, AbortAtAClearHeightLetsTheModuleRetreat) {
  RigBench bench;
  bench.plug_both();
  ASSERT_TRUE(bench.start(bench_program(printing())));
  ASSERT_TRUE(bench.run_until([&] { return bench.extruder.state == wire::State::kReady; }));
  ASSERT_TRUE(bench.order(AbortOrder{}).ok());
  ASSERT_TRUE(bench.run_until([&] { return bench.extruder.state == wire::State::kClosed; }, 10s));
  EXPECT_EQ(bench.state(), RigState::kIdle);
}

TEST(Sequencer, EmergencyResetsAtOnceAndStopsFeedingTheExtruder) {
  RigBench bench;
  start_depositing(bench);
  bench.order_of_events.clear();
  ASSERT_TRUE(bench.order(EmergencyOrder{}).ok());
  EXPECT_EQ(bench.order_of_events, (Words{"M73", "reset"}));
  EXPECT_EQ(bench.job_state(), JobState::kAborted);
  bench.run_for(6s);
  EXPECT_FALSE(bench.extruder.hot());
  EXPECT_EQ(bench.state(), RigState::kFault);
}

TEST(Sequencer, AnErrorInMidBufferHoldsBeforeItResets) {
  RigBench bench;
  start_milling(bench);
  bool spoilt = false;
  bench.spoil = [&](std::string said) {
    const std::size_t at = said.find("ok");
    if (!spoilt && at != std::string::npos) {
      spoilt = true;
      said.replace(at, 2, "error:33");
    }
    return said;
  };
  bench.order_of_events.clear();
  ASSERT_TRUE(bench.run_to_end());
  EXPECT_EQ(bench.job_state(), JobState::kFailed);
  EXPECT_NE(bench.job_sentence().find("error:33, the motion's target is not valid"),
            std::string::npos);
  EXPECT_TRUE(in_order(bench.order_of_events, {"M73", "!", "reset"}));
  EXPECT_TRUE(std::ranges::none_of(
      bench.cnc_log, [](const CncEvent& e) { return e.kind == CncEvent::Kind::kAlarm; }));
  ASSERT_TRUE(bench.run_until([&] { return bench.state() == RigState::kIdle; }, 5s));
}

TEST(Sequencer, ATargetOutsideTheTravelIsAnAlarmThatTheOperatorClears) {
  RigBench bench;
  bench.plug_both();
  ASSERT_TRUE(bench.start(bench_program({"G0 X0 Y0 Z20", "G1 X50 F600", "G1 X500", "G1 X0"})));
  ASSERT_TRUE(bench.run_to_end());
  EXPECT_EQ(bench.job_state(), JobState::kFailed);
  EXPECT_NE(bench.job_sentence().find("ALARM:2"), std::string::npos);
  bench.run_for(2s);
  ASSERT_TRUE(bench.state() == RigState::kFault || bench.state() == RigState::kIdle);
  if (bench.state() == RigState::kFault) {
    ASSERT_TRUE(bench.order(ClearOrder{}).ok());
  }
  ASSERT_TRUE(bench.run_until([&] { return bench.state() == RigState::kIdle; }, 5s));
}

TEST(Sequencer, ABannerInMidJobStopsAndIsNeverResumed) {
  RigBench bench;
  start_depositing(bench);
  bench.order_of_events.clear();
  bench.power_cycle_cnc();
  bench.run_for(1ms);
  EXPECT_EQ(bench.job_state(), JobState::kInterrupted);
  EXPECT_EQ(bench.order_of_events, (Words{"M73", "reset"}));
  EXPECT_EQ(bench.state(), RigState::kFault);
  EXPECT_FALSE(bench.order(ResumeOrder{true}).ok());
  bench.run_for(6s);
  EXPECT_FALSE(bench.extruder.hot());
}

TEST(Sequencer, ALostAcknowledgementEndsTheJobInsteadOfHangingIt) {
  RigBench bench;
  start_milling(bench, 60);
  bool lost = false;
  bench.spoil = [&](std::string said) {
    const std::size_t at = said.find("ok\r\n");
    if (!lost && at != std::string::npos) {
      lost = true;
      said.erase(at, 4);
    }
    return said;
  };
  ASSERT_TRUE(bench.run_to_end());
  EXPECT_EQ(bench.job_state(), JobState::kInterrupted);
  EXPECT_NE(bench.job_sentence().find("acknowledgement was lost"), std::string::npos)
      << bench.job_sentence();
}

TEST(Sequencer, ADoubledAcknowledgementIsFoundAtTheNextBarrier) {
  RigBench bench;
  bench.plug_both();
  ASSERT_TRUE(bench.start(bench_program(printing())));
  ASSERT_TRUE(bench.run_until([&] { return bench.extruder.state == wire::State::kReady; }));
  bool doubled = false;
  bench.spoil = [&](std::string said) {
    const std::size_t at = said.find("ok\r\n");
    if (!doubled && at != std::string::npos) {
      doubled = true;
      said.insert(at, "ok\r\n");
    }
    return said;
  };
  ASSERT_TRUE(bench.run_to_end());
  EXPECT_EQ(bench.job_state(), JobState::kInterrupted);
  EXPECT_NE(bench.job_sentence().find("more lines than it was sent"), std::string::npos)
      << bench.job_sentence();
}

TEST(Sequencer, AnUnpluggedCncStopsExtrusionAndIsHeldFirstWhenItReturns) {
  RigBench bench;
  start_depositing(bench);
  bench.owes_hold = true;
  bench.unplug(Link::kCnc);
  EXPECT_EQ(bench.job_state(), JobState::kInterrupted);
  EXPECT_FALSE(bench.extruder.pushes());
  bench.run_for(5s);
  EXPECT_FALSE(bench.extruder.hot());
  bench.only_holds_and_queries = true;
  bench.plug(Link::kCnc);
  bench.run_for(5s);
  EXPECT_EQ(bench.state(), RigState::kSuspended);
  bench.only_holds_and_queries = false;
  ASSERT_TRUE(bench.order(ClearOrder{true}).ok());
  ASSERT_TRUE(bench.run_until([&] { return bench.state() == RigState::kIdle; }, 10s))
      << bench.core.snapshot().sentence;
}

TEST(Sequencer, ASilentCncIsHeldAndItsPortOpenedAgain) {
  RigBench bench;
  start_milling(bench);
  bench.owes_hold = true;
  bench.cnc_mute = true;
  ASSERT_TRUE(bench.run_to_end());
  EXPECT_EQ(bench.job_state(), JobState::kInterrupted);
  EXPECT_NE(bench.job_sentence().find("not answered"), std::string::npos);
  EXPECT_EQ(bench.order_of_events.back(), "!");
  bench.only_holds_and_queries = true;
  bench.run_for(2s);
  bench.cnc_mute = false;
  bench.run_for(2s);
  EXPECT_EQ(bench.state(), RigState::kSuspended);
}

TEST(Sequencer, AnUnpluggedExtruderHoldsTheCnc) {
  RigBench bench;
  start_depositing(bench);
  bench.order_of_events.clear();
  bench.unplug(Link::kExtruder);
  EXPECT_EQ(bench.order_of_events, (Words{"!"}));
  ASSERT_TRUE(bench.run_to_end());
  EXPECT_EQ(bench.job_state(), JobState::kInterrupted);
  bench.run_for(4s);
  EXPECT_FALSE(bench.extruder.hot());
  EXPECT_EQ(bench.state(), RigState::kDisconnected);
}

TEST(Sequencer, ASilentExtruderHoldsTheCncWithinItsDeadline) {
  RigBench bench;
  start_depositing(bench);
  const Instant silent = bench.now;
  bench.extruder.mute = true;
  ASSERT_TRUE(bench.run_until([&] { return bench.state() == RigState::kStopping; }, 2s));
  EXPECT_LE(bench.now - silent, 700ms);
  EXPECT_FALSE(bench.extruder.pushes()) << "the M73 of last resort still went out";
}

TEST(Sequencer, AFirmwareFaultWhileDepositingHoldsAtOnce) {
  RigBench bench;
  start_depositing(bench);
  bench.order_of_events.clear();
  bench.extruder.latch(wire::Fault::kFilamentOut);
  bench.run_for(10ms);
  ASSERT_FALSE(bench.order_of_events.empty());
  EXPECT_TRUE(in_order(bench.order_of_events, {"M73", "!"}));
  ASSERT_TRUE(bench.run_to_end());
  EXPECT_EQ(bench.job_state(), JobState::kFailed);
  EXPECT_NE(bench.job_sentence().find("ilament"), std::string::npos);
}

TEST(Sequencer, ABoardThatResetsInMidJobEndsIt) {
  RigBench bench;
  start_depositing(bench);
  bench.extruder.power_cycle(bench.now);
  ASSERT_TRUE(bench.run_to_end());
  EXPECT_EQ(bench.job_state(), JobState::kFailed);
  EXPECT_NE(bench.job_sentence().find("reset by itself"), std::string::npos);
}

TEST(Sequencer, ARefusedCodeFailsTheJob) {
  RigBench bench;
  bench.plug_both();
  ASSERT_TRUE(bench.start(bench_program(printing())));
  ASSERT_TRUE(bench.run_until([&] { return bench.extruder.state == wire::State::kReady; }));
  bench.extruder.refuses_next = true;
  ASSERT_TRUE(bench.run_to_end());
  EXPECT_EQ(bench.job_state(), JobState::kFailed);
  EXPECT_NE(bench.job_sentence().find("did not do M72"), std::string::npos);
}

TEST(Sequencer, ALostDoneIsFoundByTheNextStatus) {
  RigBench bench;
  bench.extruder.forgets_done = true;
  bench.plug_both();
  ASSERT_TRUE(bench.start(bench_program(printing())));
  ASSERT_TRUE(bench.run_to_end());
  EXPECT_EQ(bench.job_state(), JobState::kDone) << bench.job_sentence();
  EXPECT_EQ(bench.m_codes(), (std::vector<int>{70, 72, 73, 74, 75, 72, 73, 74, 75, 71}));
}

TEST(Sequencer, APanelHoldWhileDepositingStopsExtrusionWithin250ms) {
  RigBench bench;
  start_depositing(bench);
  const Instant held = bench.now;
  bench.cnc->set_hold_input(true);
  ASSERT_TRUE(bench.run_until([&] { return !bench.extruder.pushes(); }, 1s));
  EXPECT_LE(bench.now - held, 250ms);
  ASSERT_TRUE(bench.run_until([&] { return bench.state() == RigState::kHeld; }, 3s));
  EXPECT_FALSE(bench.order(ResumeOrder{}).ok());
}

TEST(Sequencer, StarvationInMidBeadStopsExtrusion) {
  RigBench bench;
  CoreOptions options = RigBench::virtual_ports();
  options.horizon_ahead = 8;
  RigBench starved(options);
  std::vector<std::string> body = {"G0 X0 Y0 Z20", "M70", "M72 P0.3"};
  for (int i = 0; i < 60; ++i) body.push_back("G1 X" + std::to_string(i + 1) + " F500");
  starved.plug_both();
  ASSERT_TRUE(starved.start(bench_program(body)));
  ASSERT_TRUE(starved.run_until([&] { return starved.core.snapshot().depositing; }));
  starved.journal_stuck = true;
  ASSERT_TRUE(starved.run_until([&] { return starved.state() == RigState::kHeld; }, 60s));
  EXPECT_FALSE(starved.extruder.pushes());
  starved.journal_stuck = false;
  ASSERT_TRUE(starved.order(ResumeOrder{true}).ok());
  starved.run_for(1s);
  EXPECT_TRUE(starved.core.snapshot().depositing);
}

TEST(Sequencer, AStuckJournalSendsNothingBeyondTheHorizon) {
  RigBench bench;
  start_milling(bench, 2000);
  bench.journal_stuck = true;
  bench.run_for(120s);
  EXPECT_EQ(bench.core.snapshot().certainty.sent, bench.horizon);
  EXPECT_EQ(bench.state(), RigState::kRunning);
  bench.journal_stuck = false;
  ASSERT_TRUE(bench.run_to_end());
  EXPECT_EQ(bench.job_state(), JobState::kDone);
}

TEST(Sequencer, AfterACrashTheFirstByteIsAHoldAndNothingElseMoves) {
  RigBench crashed;
  start_depositing(crashed);
  // The daemon is gone; a new one finds both devices as they were.
  CoreOptions options = RigBench::virtual_ports();
  options.extruder_session = 4711;
  RigBench bench(options);
  bench.cnc = std::move(crashed.cnc);
  bench.extruder = crashed.extruder;
  bench.now = crashed.now + 700ms;
  bench.core.recover_interrupted();
  bench.owes_hold = bench.only_holds_and_queries = true;
  bench.plug_both();
  bench.run_for(10s);
  EXPECT_EQ(bench.state(), RigState::kFault) << "the board's dead-man has latched";
  EXPECT_FALSE(bench.extruder.pushes());
  EXPECT_FALSE(bench.extruder.hot());
  EXPECT_EQ(bench.cnc->state_name(), "Hold:0");
  const Status refused = bench.order(ResumeOrder{true});
  EXPECT_FALSE(refused.ok());
  bench.only_holds_and_queries = false;
  ASSERT_TRUE(bench.order(ClearOrder{true}).ok());
  ASSERT_TRUE(bench.run_until([&] { return bench.state() == RigState::kIdle; }, 10s))
      << bench.core.snapshot().sentence;
}

TEST(Sequencer, AfterACrashInMillingTheRigIsSuspendedUntilCleared) {
  RigBench crashed;
  start_milling(crashed);
  CoreOptions options = RigBench::virtual_ports();
  options.extruder_session = 4711;
  RigBench bench(options);
  bench.cnc = std::move(crashed.cnc);
  bench.extruder = crashed.extruder;
  bench.now = crashed.now + 200ms;
  bench.core.recover_interrupted();
  bench.owes_hold = bench.only_holds_and_queries = true;
  bench.plug_both();
  bench.run_for(10s);
  EXPECT_EQ(bench.state(), RigState::kSuspended) << bench.core.snapshot().sentence;
  EXPECT_EQ(bench.cnc->state_name(), "Hold:0");
  bench.only_holds_and_queries = false;
  ASSERT_TRUE(bench.order(ClearOrder{}).ok());
  ASSERT_TRUE(bench.run_until([&] { return bench.state() == RigState::kIdle; }, 10s));
}

TEST(Sequencer, ABoardThatCountsAnotherSessionsOrdersIsGreetedAnew) {
  RigBench crashed;
  start_milling(crashed);
  RigBench bench;  // by chance the same session number
  bench.extruder = crashed.extruder;
  bench.now = crashed.now;
  bench.core.recover_interrupted();
  bench.plug_both();
  bench.run_for(8s);
  EXPECT_NE(bench.state(), RigState::kDisconnected);
  EXPECT_EQ(bench.extruder.executed.back().m_code, 73);
}

TEST(Sequencer, ShutdownHoldsAndInterruptsTheJob) {
  RigBench bench;
  start_depositing(bench);
  ASSERT_TRUE(bench.order(ShutdownOrder{}).ok());
  EXPECT_EQ(bench.job_state(), JobState::kInterrupted);
  EXPECT_TRUE(in_order(bench.order_of_events, {"M72", "M73", "!"}));
}

TEST(Sequencer, AnIdleRigSendsAtMostTwoQueriesASecond) {
  RigBench bench;
  bench.plug_both();
  ASSERT_TRUE(bench.run_until([&] { return bench.state() == RigState::kIdle; }));
  bench.cnc_bytes.clear();
  bench.run_for(10s);
  EXPECT_LE(std::ranges::count(bench.cnc_bytes, '?'), 21);
  EXPECT_GE(std::ranges::count(bench.cnc_bytes, '?'), 19);
}

TEST(Sequencer, ARunningJobIsPolledAtFiveHertz) {
  RigBench bench;
  start_milling(bench, 2000);
  bench.cnc_bytes.clear();
  bench.run_for(10s);
  EXPECT_LE(std::ranges::count(bench.cnc_bytes, '?'), 51);
  EXPECT_GE(std::ranges::count(bench.cnc_bytes, '?'), 49);
}

}  // namespace
}  // namespace reforge
