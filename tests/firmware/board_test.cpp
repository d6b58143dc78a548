// The real firmware ELF in simavr, with bytes, pins and heat around it.

#include <algorithm>
#include <cstdio>
#include <random>
#include <utility>
#include <vector>

#include "tests/firmware/bench.h"

namespace reforge {
namespace {

using wire::Fault;
using wire::Reason;
using wire::Setting;
using wire::State;
using wire::Type;

TEST(Board, SaysItsBannerAtPowerOn) {
  Bench bench;
  const auto frame = bench.await(Type::kBanner, 50);
  ASSERT_TRUE(frame.has_value());
  wire::Banner banner;
  ASSERT_TRUE(unpack(*frame, banner));
  EXPECT_EQ(banner.protocol_version, wire::kProtocolVersion);
  EXPECT_EQ(banner.reset_cause, wire::kResetPowerOn);
  EXPECT_EQ(banner.session, 0);
  EXPECT_EQ(banner.state, State::kClosed);
  const BoardOutputs outputs = bench.board().outputs();
  EXPECT_FALSE(outputs.heater_on);
  EXPECT_FALSE(outputs.run_permitted);
  EXPECT_EQ(outputs.servo_pulse_us, 0);
}

TEST(Board, HeatsToItsTargetAndSaysSo) {
  Bench bench = Bench::greeted();
  bench.command(70, 2050);
  EXPECT_EQ(bench.await_ack().state, State::kOpening);
  const wire::Done done = bench.await_done(300'000);
  EXPECT_EQ(done.reason, Reason::kNone);
  EXPECT_EQ(done.state, State::kReady);
  EXPECT_NEAR(bench.board().hot_end().sensor_c(), 205, 3);
  EXPECT_NEAR(bench.board().outputs().servo_pulse_us, 2000, 10);
  bench.run_ms(30'000);
  EXPECT_NEAR(bench.board().hot_end().sensor_c(), 205, 2);
}

TEST(Board, ExtrudesRateTimesTime) {
  for (const int32_t speed : {350, 1000, 20'000}) {
    Bench bench = Bench::greeted();
    bench.open_hot();
    bench.command(72, speed);
    EXPECT_EQ(bench.await_done(10).state, State::kExtruding);
    const int64_t start_ms = bench.now_ms();
    bench.run_ms(3000);
    bench.command(73);
    const int64_t stop_ms = bench.now_ms();
    const wire::Done done = bench.await_done(500);
    EXPECT_EQ(done.state, State::kReady);
    // Ramps of 200 mm/s^2 are symmetrical: what is missing at the start is made up by the end.
    const double expected = speed / 1000.0 * 0.42 * static_cast<double>(stop_ms - start_ms);
    EXPECT_NEAR(static_cast<double>(bench.board().position()), expected, expected * 0.01);
    EXPECT_EQ(done.position, bench.board().position());
    EXPECT_EQ(bench.status().position, bench.board().position());
    const std::vector<StepEdge> steps = bench.board().take_steps();
    EXPECT_EQ(static_cast<int64_t>(steps.size()), bench.board().position());
    const double even_ns = 1e9 / (speed / 1000.0 * 420);
    for (size_t i = steps.size() / 4; i < steps.size() / 2;
         ++i) {  // at full speed, servo pulses beside
      EXPECT_NEAR(static_cast<double>(steps[i].ns - steps[i - 1].ns), even_ns, 5000) << i;
    }
  }
}

TEST(Board, RestoresExactlyWhatItRetracted) {
  Bench bench = Bench::greeted();
  bench.open_hot();
  bench.command(74, 1000);
  wire::Done done = bench.await_done(500);
  EXPECT_EQ(done.state, State::kRetracted);
  EXPECT_EQ(bench.board().position(), -420);
  bench.command(75);
  EXPECT_EQ(bench.await_done(10).state, State::kReady);
  bench.board().take_steps();
  bench.command(72, 350);
  done = bench.await_done(500);
  EXPECT_EQ(done.state, State::kExtruding);
  EXPECT_GE(done.position, -1);
  EXPECT_LE(done.position, 1);
  for (const StepEdge& step : bench.board().take_steps()) EXPECT_EQ(step.direction, 1);
}

TEST(Board, ReversedDirectionTurnsThePin) {
  Bench bench = Bench::greeted();
  bench.set(Setting::kReverseDirection, 1);
  bench.open_hot();
  bench.command(74, 1000);
  bench.await_done(500);
  EXPECT_EQ(bench.board().position(), 420);
  EXPECT_EQ(bench.status().position, -420);
}

TEST(Board, SilenceStopsExtrusionThenHeatIsOff) {
  Bench bench = Bench::greeted();
  bench.open_hot();
  bench.command(72, 5000);
  bench.await_done(10);
  bench.run_ms(1000);
  EXPECT_TRUE(bench.board().outputs().run_permitted);
  bench.silence(true);
  bench.send(wire::pack(Type::kHeartbeat, 1));
  bench.run_ms(490);
  EXPECT_EQ(bench.status().state, State::kExtruding);
  const int64_t asked_ms = bench.now_ms();
  bench.board().take_steps();
  bench.run_ms(5000);
  const auto steps = bench.board().take_steps();
  ASSERT_FALSE(steps.empty());
  EXPECT_LE(steps.back().ns / kMs - asked_ms, 502);
  EXPECT_FALSE(bench.board().outputs().heater_on);
  EXPECT_FALSE(bench.board().outputs().motor_enabled);
  EXPECT_FALSE(bench.board().outputs().run_permitted);
  EXPECT_EQ(bench.status().fault, Fault::kExtrusionSilence);
}

TEST(Board, RunPermissionFollowsTheLink) {
  Bench bench = Bench::greeted();
  bench.run_ms(200);
  EXPECT_TRUE(bench.board().outputs().run_permitted);
  bench.silence(true);
  bench.run_ms(3200);
  EXPECT_FALSE(bench.board().outputs().run_permitted);
  bench.silence(false);
  bench.run_ms(200);
  EXPECT_TRUE(bench.board().outputs().run_permitted);
}

TEST(Board, ADisconnectedSensorLatchesAFault) {
  for (const auto& [wiring, fault] : {std::pair{SensorWiring::kOpen, Fault::kSensorOpen},
                                      std::pair{SensorWiring::kShort, Fault::kSensorShort}}) {
    Bench bench = Bench::greeted();
    bench.open_hot();
    bench.command(72, 1000);
    bench.await_done(10);
    bench.board().hot_end().set_sensor(wiring);
    wire::FaultReport report = {};
    const auto frame = bench.await(Type::kFault, 400);
    ASSERT_TRUE(frame && unpack(*frame, report));
    EXPECT_EQ(report.fault, fault);
    EXPECT_EQ(report.state_before, State::kExtruding);
    bench.board().take_steps();
    bench.board().take_heater_duty();
    bench.run_ms(2000);
    EXPECT_TRUE(bench.board().take_steps().empty());
    EXPECT_EQ(bench.board().take_heater_duty(), 0);
    EXPECT_EQ(bench.status().temperature, wire::kTemperatureUnknown);
  }
}

TEST(Board, AFallenOutSensorCannotHeatForever) {
  Bench bench = Bench::greeted();
  bench.open_hot();
  bench.board().hot_end().set_sensor(SensorWiring::kFallenOut);
  ASSERT_TRUE(bench.await(Type::kFault, 60'000).has_value());
  EXPECT_EQ(bench.status().fault, Fault::kRunaway);
  EXPECT_FALSE(bench.board().outputs().heater_on);
}

TEST(Board, ResetsColdAndStill) {
  Bench bench = Bench::greeted();
  bench.open_hot();
  bench.command(72, 5000);
  bench.await_done(10);
  bench.board().reset(BoardReset::kButton);
  EXPECT_FALSE(bench.board().outputs().heater_on);
  EXPECT_FALSE(bench.board().outputs().motor_enabled);
  wire::Banner banner = {};
  const auto frame = bench.await(Type::kBanner, 50);
  ASSERT_TRUE(frame && unpack(*frame, banner));
  EXPECT_EQ(banner.session, 0);
  EXPECT_EQ(banner.reset_cause, wire::kResetExternal);
  EXPECT_EQ(banner.state, State::kClosed);
  bench.board().take_steps();
  bench.run_ms(1000);
  EXPECT_TRUE(bench.board().take_steps().empty());
  bench.command(72);
  EXPECT_EQ(bench.await_ack().reason, Reason::kNoHello);
}

TEST(Board, ABrownOutSaysSo) {
  Bench bench = Bench::greeted();
  bench.board().reset(BoardReset::kBrownOut);
  wire::Banner banner = {};
  const auto frame = bench.await(Type::kBanner, 50);
  ASSERT_TRUE(frame && unpack(*frame, banner));
  EXPECT_EQ(banner.reset_cause, wire::kResetBrownOut);
}

TEST(Board, AHangIsEndedByTheWatchdog) {
  Bench bench = Bench::greeted();
  bench.open_hot();
  bench.run_ms(2000);
  bench.board().hang();
  bench.board().hang();  // no more than that
  wire::Banner banner = {};
  const auto frame = bench.await(Type::kBanner, 1500);
  ASSERT_TRUE(frame && unpack(*frame, banner));
  EXPECT_EQ(banner.reset_cause, wire::kResetWatchdog);
  EXPECT_EQ(bench.board().resets_seen(), 1);
  bench.board().take_heater_duty();
  bench.run_ms(3000);
  EXPECT_EQ(bench.board().take_heater_duty(), 0);
  EXPECT_EQ(bench.board().resets_seen(), 1);  // it does not bite again while nothing hangs
}

TEST(Board, SettingsSurviveAResetInEeprom) {
  Bench bench = Bench::greeted();
  bench.set(Setting::kRetractLength, 1234);
  bench.order(wire::pack(Type::kSaveSettings, 0));
  EXPECT_EQ(bench.await_ack().reason, Reason::kNone);
  EXPECT_EQ(bench.await_done(2000).reason, Reason::kNone);
  bench.board().reset(BoardReset::kButton);
  bench.run_ms(100);
  bench.send(pack(wire::GetSetting{Setting::kRetractLength}, 5));
  wire::SettingValue value = {};
  const auto frame = bench.await(Type::kSettingValue, 20);
  ASSERT_TRUE(frame && unpack(*frame, value));
  EXPECT_EQ(value.value, 1234);
}

TEST(Board, APersonCanWorkItByText) {
  Bench bench;
  bench.board().hot_end().set_temperature(200);
  bench.run_ms(200);
  bench.send_text("M70 S205\n");
  bench.run_ms(30'000);
  EXPECT_EQ(bench.take_text(), "ok\n");
  bench.send_text("M72 L2 F5\n");
  bench.run_ms(1000);
  EXPECT_EQ(bench.take_text(), "ok\n");
  EXPECT_EQ(bench.board().position(), 840);
}

TEST(Board, TheCncsRelaysWorkIt) {
  Bench bench = Bench::greeted();
  bench.set(Setting::kInStream, 1);
  AvrBoard& board = bench.board();
  board.hot_end().set_temperature(203);
  bench.run_ms(200);
  board.set_signal(CncSignal::kOpenModule, true);
  board.set_signal(CncSignal::kRunning, true);
  bench.run_ms(50);
  EXPECT_FALSE(board.outputs().ready);
  bench.run_ms(30'000);
  EXPECT_TRUE(board.outputs().ready);
  EXPECT_TRUE(board.outputs().module_relay);
  board.set_signal(CncSignal::kExtrude, true);
  bench.run_ms(1000);
  board.set_signal(CncSignal::kExtrude, false);
  bench.run_ms(100);
  EXPECT_NEAR(static_cast<double>(board.position()), 147, 3);
  EXPECT_EQ(bench.status().fault, Fault::kNone);
}

TEST(Board, FilamentSensorStopsExtrusion) {
  Bench bench = Bench::greeted();
  bench.set(Setting::kFilamentSensor, 1);
  bench.open_hot();
  bench.command(72, 1000);
  EXPECT_EQ(bench.await_done(10).reason, Reason::kNone);
  bench.board().set_filament_present(false);
  ASSERT_TRUE(bench.await(Type::kFault, 100).has_value());
  EXPECT_EQ(bench.status().fault, Fault::kFilamentOut);
}

// At the full rate of 20,000 steps/s: counts, evenness, and whether it still answers.
TEST(Board, AnswersAndStepsEvenlyAtFullRate) {
  Bench bench = Bench::greeted();
  bench.set(Setting::kStepsPerMetre, 400'000);
  bench.set(Setting::kAcceleration, 2'000'000);
  bench.open_hot();
  AvrBoard& board = bench.board();
  board.take_steps();
  bench.command(72, 50'000);
  const int64_t asked_ns = board.receive_idle_ns();
  EXPECT_EQ(bench.await_done(50).reason, Reason::kNone);
  bench.run_ms(100);
  auto steps = board.take_steps();
  ASSERT_FALSE(steps.empty());
  EXPECT_LE(steps.front().ns - asked_ns, kMs);  // M72 to first step
  RecordProperty("first_step_us", static_cast<int>((steps.front().ns - asked_ns) / 1000));

  bench.silence(true);
  int64_t slowest_ns = 0;
  for (int i = 0; i < 200; ++i) {
    bench.run_ms(6 + i % 3);
    board.advance_to(board.now_ns() + i * 4999);
    bench.send(wire::pack(i % 2 ? Type::kStatusQuery : Type::kHeartbeat, 1));
    const int64_t sent_ns = board.receive_idle_ns();
    while (board.last_transmit_start_ns() < sent_ns && board.now_ns() < sent_ns + 5 * kMs) {
      board.advance_to(board.now_ns() + 10'000);
    }
    slowest_ns = std::max(slowest_ns, board.last_transmit_start_ns() - sent_ns);
  }
  EXPECT_LE(slowest_ns, 2 * kMs);
  RecordProperty("slowest_answer_us", static_cast<int>(slowest_ns / 1000));

  steps = board.take_steps();
  ASSERT_GT(steps.size(), 10'000u);
  // Against an even rhythm from the first step on.
  int64_t earliest = 0, latest = 0;
  for (size_t i = 0; i < steps.size(); ++i) {
    const int64_t off = steps[i].ns - steps[0].ns - static_cast<int64_t>(i) * 50'000;
    earliest = std::min(earliest, off);
    latest = std::max(latest, off);
  }
  EXPECT_LE(latest - earliest, 4'000);
  RecordProperty("jitter_ns", static_cast<int>(latest - earliest));
  bench.command(73);
  const wire::Done stopped = bench.await_done(500);
  EXPECT_EQ(stopped.position, board.position());
}

// Every path that goes deep, at full step rate: orders, settings, EEPROM, text, relays, faults.
TEST(Board, StaysWithinHalfOfFlashAndRamWithItsDeepestStack) {
  Bench bench = Bench::greeted();
  bench.set(Setting::kStepsPerMetre, 400'000);
  bench.set(Setting::kAcceleration, 2'000'000);
  bench.order(wire::pack(Type::kSaveSettings, 0));
  EXPECT_EQ(bench.await_ack().reason, Reason::kNone);
  EXPECT_EQ(bench.await_done(2000).reason, Reason::kNone);
  bench.open_hot();
  bench.command(72, 50'000);
  for (int i = 0; i < 100; ++i) {
    bench.run_ms(3);
    bench.send(wire::pack(Type::kStatusQuery, 1));
    bench.send(pack(wire::GetSetting{Setting::kPidP}, 2));
    bench.send(pack(wire::Hello{wire::kProtocolVersion, 7}, 0));
  }
  bench.command(74, 1000);  // refused
  bench.command(73);
  bench.run_ms(300);
  bench.command(74, 2000);
  bench.run_ms(300);
  bench.command(75);
  bench.run_ms(50);
  bench.command(72, 50'000);
  bench.run_ms(300);
  bench.board().hot_end().set_sensor(SensorWiring::kOpen);
  bench.run_ms(500);
  bench.board().hot_end().set_sensor(SensorWiring::kConnected);
  bench.run_ms(300);
  bench.order(wire::pack(Type::kClearFault, 0));
  bench.run_ms(50);
  while (bench.await(Type::kDone, 0)) {
  }
  bench.set(Setting::kInStream, 1);
  bench.board().set_signal(CncSignal::kRunning, true);
  bench.board().set_signal(CncSignal::kOpenModule, true);
  bench.run_ms(5000);
  bench.board().set_signal(CncSignal::kExtrude, true);
  bench.run_ms(500);
  bench.board().set_signal(CncSignal::kRunning, false);
  bench.run_ms(200);
  bench.silence(true);
  bench.run_ms(4000);
  for (const char* line : {"?\n", "CLEAR\n", "M70 S205\n", "M72 L199.999 F50.123\n", "M73\n",
                           "M74 L1.5\n", "?\n", "nonsense that is far too long for a line\n"}) {
    bench.send_text(line);
    bench.run_ms(300);
  }
  AvrBoard& board = bench.board();
  const int used = 2048 - board.ram_never_used();
  std::printf(
      "arduino-extruder: flash %d of 32256 bytes, static RAM %d, with deepest stack %d of 2048\n",
      board.flash_bytes(), board.static_ram_bytes(), used);
  EXPECT_LE(board.flash_bytes(), 32'256 / 2);
  EXPECT_LE(used, 2048 / 2);
}

TEST(Board, TheSameRunGivesTheSameBytesAndSteps) {
  const auto run = [] {
    Bench bench = Bench::greeted();
    bench.open_hot();
    bench.command(72, 1000);
    bench.run_ms(500);
    std::vector<int64_t> trace;
    for (const StepEdge& step : bench.board().take_steps()) trace.push_back(step.ns);
    trace.push_back(static_cast<int64_t>(bench.board().hot_end().block_c() * 1e9));
    return trace;
  };
  EXPECT_EQ(run(), run());
}

TEST(Board, CountsAgreeOverRandomCommands) {
  std::mt19937 engine(3);
  const auto random = [&engine] { return static_cast<uint32_t>(engine()); };
  Bench bench = Bench::greeted();
  bench.open_hot();
  for (int i = 0; i < 300; ++i) {
    const uint8_t code = static_cast<uint8_t>(72 + random() % 4);
    bench.command(code, code == 72 ? static_cast<int32_t>(100 + random() % 40'000) : 0);
    bench.run_ms(random() % 150);
  }
  bench.command(73);
  bench.run_ms(1000);
  const wire::Status status = bench.status();
  EXPECT_EQ(status.fault, Fault::kNone);
  EXPECT_EQ(status.position, bench.board().position());
}

}  // namespace
}  // namespace reforge
