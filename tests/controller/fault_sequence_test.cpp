// Seeded years of bad luck: jobs are disturbed at random moments by random faults and random
// orders, and what must never happen is checked on every byte (rig_bench.h) and at the end.
// A failure prints its seed; FaultSequence.* replays it.
#include <gtest/gtest.h>

#include <random>

#include "tests/controller/support/rig_bench.h"

namespace reforge {
namespace {

using namespace std::chrono_literals;

class Disturber {
 public:
  Disturber(RigBench& bench, unsigned seed) : bench_(bench), random_(seed) {
    bench_.spoil = [this](std::string said) { return spoil(std::move(said)); };
  }

  void disturb() {
    switch (random_() % 16) {
      case 0:
        return unplug(Link::kCnc);
      case 1:
        return unplug(Link::kExtruder);
      case 2:
        return what_next("error:1\r\n");
      case 3:
        bench_.doubled_acknowledgement = true;
        return what_next("ok\r\nok\r\n");
      case 4:
        return what_next("");
      case 5:
        return what_next("o\x80\r\n");
      case 6:
        done = "ALARM said";
        bench_.core.receive(bench_.now, Link::kCnc, "ALARM:1\r\n");
        return bench_.settle();
      case 7:
        done = "CNC power cycle";
        bench_.power_cycle_cnc();
        return bench_.settle();
      case 8:
        done = "hold input";
        return bench_.cnc->set_hold_input(true);
      case 9:
        done = "board reset";
        return bench_.extruder.power_cycle(bench_.now);
      case 10:
        done = "board fault";
        return bench_.extruder.latch(wire::Fault::kRunaway);
      case 11:
        done = "board mute";
        bench_.extruder.mute = true;
        return;
      case 12:
        done = "board refuses";
        bench_.extruder.refuses_next = true;
        return;
      case 13:
        done = "CNC mute";
        bench_.cnc_mute = true;
        return;
      case 14:
        return order();
      default:
        done = "garbage";
        for (int i = 0; i < 50; ++i) {
          std::string bytes;
          for (int n = 0; n < 40; ++n) bytes += static_cast<char>(random_() % 256);
          bench_.core.receive(bench_.now, random_() % 2 ? Link::kCnc : Link::kExtruder, bytes);
        }
        return bench_.settle();
    }
  }

  void mend() {
    bench_.spoil = nullptr;
    bench_.cnc_mute = false;
    bench_.extruder.mute = false;
    bench_.extruder.refuses_next = false;
    bench_.cnc->set_hold_input(false);
  }

  std::string done = "nothing";

 private:
  void unplug(Link link) {
    done = "unplug " + std::string(name(link));
    if (bench_.plugged(link)) bench_.unplug(link);
  }
  void what_next(std::string instead) {
    done = "ok becomes '" + instead + "'";
    instead_ = std::move(instead);
    armed_ = true;
  }
  std::string spoil(std::string said) {
    const std::size_t at = said.find("ok\r\n");
    if (armed_ && at != std::string::npos) {
      armed_ = false;
      said.replace(at, 4, instead_);
    }
    return said;
  }
  void order() {
    const OperatorOrder orders[] = {HoldOrder{},      ResumeOrder{true}, AbortOrder{},
                                    EmergencyOrder{}, ClearOrder{false}, ShutdownOrder{}};
    const auto index = random_() % std::size(orders);
    done = "order " + std::to_string(index);
    const Status answer = bench_.order(orders[index]);
    if (!answer) {
      EXPECT_FALSE(answer.error().sentence.empty());
    }
  }

  RigBench& bench_;
  std::mt19937 random_;
  bool armed_ = false;
  std::string instead_;
};

void one_life(unsigned seed) {
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  RigBench bench;
  Disturber disturber(bench, seed * 31 + 7);
  bench.plug_both();
  const bool prints = random() % 4 != 0;
  ASSERT_TRUE(bench.start(bench_program(prints ? printing(25) : milling(120)))) << bench.refusal;

  bench.run_for(std::chrono::milliseconds(random() % 14000));
  std::string history;
  for (auto n = 1 + random() % 3; n > 0; --n) {
    disturber.disturb();
    history += disturber.done + "; ";
    bench.run_for(std::chrono::milliseconds(random() % 1500));
  }
  SCOPED_TRACE(history);

  // Whatever happened, the job comes to an end or waits for the operator in hold.
  bench.run_until([&] { return bench.job_over() || bench.state() == RigState::kHeld; }, 120s);
  if (bench.state() == RigState::kHeld) {
    ASSERT_TRUE(bench.order(AbortOrder{}).ok());
    ASSERT_TRUE(bench.run_until([&] { return bench.job_over(); }, 20s));
  }
  const bool ready_again = bench.job_state() == JobState::kReady;
  ASSERT_TRUE(bench.job_over() || ready_again) << name(bench.state());
  bench.run_for(1s);
  EXPECT_FALSE(bench.extruder.pushes());
  bench.run_for(12s);
  EXPECT_FALSE(bench.extruder.hot()) << "heat without a job";
  EXPECT_EQ(
      std::ranges::count_if(bench.jobs, [](const JobChanged& j) { return api::is_over(j.state); }),
      ready_again ? 0 : 1);
  if (bench.job_state() == JobState::kDone) {
    EXPECT_EQ(bench.jobs.back().certainty.executed, bench.lines_total);
  }

  // And when all is mended, plugged in and cleared, the rig takes a job again.
  disturber.mend();
  bench.plug_both();
  bench.power_cycle_cnc();
  bench.settle();
  for (int i = 0; i < 6 && bench.state() != RigState::kIdle; ++i) {
    bench.run_for(6s);
    (void)bench.order(ClearOrder{.module_may_retreat = true});
    bench.run_until([&] { return bench.state() == RigState::kIdle; }, 6s);
  }
  EXPECT_EQ(bench.state(), RigState::kIdle) << bench.core.snapshot().sentence;
}

TEST(FaultSequence, FourHundredDisturbedJobsKeepTheInvariants) {
  for (unsigned seed = 1; seed <= 400 && !testing::Test::HasFailure(); ++seed) one_life(seed);
}

}  // namespace
}  // namespace reforge
