#include "tests/firmware/bench.h"

#include <utility>

namespace reforge {

Bench::Bench() {
  auto opened = AvrBoard::open(REFORGE_FIRMWARE_ELF);
  if (!opened) throw std::runtime_error(opened.error().sentence);
  board_ = std::move(opened).value();
}

Bench Bench::greeted() {
  Bench bench;
  bench.await(wire::Type::kBanner, 50);
  bench.send(pack(wire::Hello{wire::kProtocolVersion, 7}, 0));
  EXPECT_TRUE(bench.await(wire::Type::kBanner, 50).has_value());
  bench.silent_ = false;
  return bench;
}

void Bench::send(const wire::Frame& frame) {
  uint8_t bytes[wire::kFrameMax];
  const uint8_t count = encode(frame, bytes);
  board_->receive({bytes, count});
}

void Bench::send_text(const std::string& text) {
  board_->receive({reinterpret_cast<const uint8_t*>(text.data()), text.size()});
}

uint8_t Bench::order(const wire::Frame& frame) {
  wire::Frame numbered = frame;
  numbered.sequence = ++order_;
  send(numbered);
  return order_;
}

uint8_t Bench::command(uint8_t m_code, int32_t argument) {
  return order(pack(wire::Command{m_code, argument}, 0));
}

void Bench::set(wire::Setting id, int32_t value) {
  order(pack(wire::SetSetting{id, value}, 0));
  EXPECT_EQ(await_ack().reason, wire::Reason::kNone);
  EXPECT_EQ(await_done(10).reason, wire::Reason::kNone);
}

void Bench::step_ms() {
  if (!silent_ && now_ms() >= next_beat_ms_) {
    next_beat_ms_ = now_ms() + 100;
    send(wire::pack(wire::Type::kHeartbeat, 0));
  }
  board_->advance_to((now_ms() + 1) * kMs);
  for (const uint8_t byte : board_->take_transmitted()) {
    if (!decoder_.push(byte)) text_ += static_cast<char>(byte);
    wire::Frame frame;
    while (decoder_.take(frame)) frames_.push_back(frame);
  }
}

void Bench::run_ms(int64_t ms) {
  const int64_t end = now_ms() + ms;
  while (now_ms() < end) step_ms();
}

std::optional<wire::Frame> Bench::await(wire::Type type, int64_t within_ms) {
  const int64_t end = now_ms() + within_ms;
  for (;;) {
    while (!frames_.empty()) {
      const wire::Frame frame = frames_.front();
      frames_.pop_front();
      if (frame.type == type) return frame;
    }
    if (now_ms() >= end) return std::nullopt;
    step_ms();
  }
}

wire::Ack Bench::await_ack(int64_t within_ms) {
  wire::Ack ack = {};
  const auto frame = await(wire::Type::kAck, within_ms);
  EXPECT_TRUE(frame && unpack(*frame, ack) && frame->sequence == order_);
  return ack;
}

wire::Done Bench::await_done(int64_t within_ms) {
  wire::Done done = {};
  const auto frame = await(wire::Type::kDone, within_ms);
  EXPECT_TRUE(frame && unpack(*frame, done) && frame->sequence == order_);
  return done;
}

wire::Status Bench::status() {
  const uint8_t question = ++question_;
  send(wire::pack(wire::Type::kStatusQuery, question));
  wire::Status status = {};
  for (;;) {
    const auto frame = await(wire::Type::kStatus, 20);
    EXPECT_TRUE(frame && unpack(*frame, status));
    if (!frame || frame->sequence == question) return status;
  }
}

void Bench::open_hot() {
  board_->hot_end().set_temperature(200);
  run_ms(200);  // the firmware has read it
  command(70, 2050);
  EXPECT_EQ(await_ack().reason, wire::Reason::kNone);
  const wire::Done done = await_done(60'000);
  EXPECT_EQ(done.reason, wire::Reason::kNone);
  EXPECT_EQ(done.state, wire::State::kReady);
}

}  // namespace reforge
