// The real firmware ELF in simavr, with bytes, pins and heat around it.

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
  Bench bench = Bench::greeted();
  bench.open_hot();
  bench.command(72, 5000);
  EXPECT_EQ(bench.await_done(10).state, State::kExtruding);
  const int64_t start_ms = bench.now_ms();
  bench.run_ms(2000);
  bench.command(73);
  const int64_t stop_ms = bench.now_ms();
  EXPECT_EQ(bench.await_done(200).state, State::kReady);
  const double expected = 5.0 * 420 * static_cast<double>(stop_ms - start_ms) / 1000;
  EXPECT_NEAR(static_cast<double>(bench.board().position()), expected, expected * 0.01);
  EXPECT_EQ(bench.status().position, bench.board().position());
}

}  // namespace
}  // namespace reforge
