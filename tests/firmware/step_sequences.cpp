#include "tests/firmware/step_sequences.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <optional>
#include <random>
#include <utility>

#include "tests/firmware/desk.h"
#include "tools/rig/avr_board.h"
#include "tools/rig/virtual_time.h"

namespace reforge {
namespace {

constexpr double kStepsPerMm = 420;

class SteppedLogic final : public SteppedBoard {
 public:
  SteppedLogic() { desk_.open_hot(); }
  bool order(uint8_t m_code, int32_t argument) override {
    if (desk_.extruder.command(m_code, argument, desk_.now_ms) != wire::Reason::kNone) return false;
    return finish();
  }
  bool extrude_length(int32_t um, int32_t um_per_s) override {
    return desk_.extruder.extrude_length(um, um_per_s) == wire::Reason::kNone && finish();
  }
  void run_ms(int64_t ms) override {
    desk_.run_ms(static_cast<uint32_t>(ms));
    desk_.timer.forget_steps();
  }
  int64_t pin() const override { return desk_.timer.position(); }
  int64_t reported() override { return desk_.extruder.position(); }

 private:
  bool finish() {
    wire::Reason reason = wire::Reason::kNone;
    for (int ms = 0; !desk_.extruder.take_finished(reason); ++ms) {
      if (ms > 5000) return false;
      run_ms(1);
    }
    return reason == wire::Reason::kNone;
  }
  Desk desk_;
};

class SteppedAvr final : public SteppedBoard {
 public:
  explicit SteppedAvr(std::unique_ptr<AvrBoard> board) : board_(std::move(board)) {
    board_->hot_end().set_temperature(205);
    run_ms(200);
    send(pack(wire::Hello{wire::kProtocolVersion, 7}, 0));
    run_ms(20);
    order(70, 2050);
  }
  bool order(uint8_t m_code, int32_t argument) override {
    done_.reset();
    refused_ = false;
    send(pack(wire::Command{m_code, argument}, ++sequence_));
    for (int ms = 0; ms < 20'000 && !done_ && !refused_; ++ms) run_ms(1);
    return done_ && done_->reason == wire::Reason::kNone;
  }
  bool extrude_length(int32_t, int32_t) override { return false; }
  void run_ms(int64_t ms) override {
    for (; ms > 0; --ms) step();
  }
  int64_t pin() const override { return board_->position(); }
  int64_t reported() override {
    status_.reset();
    send(wire::pack(wire::Type::kStatusQuery, 0));
    for (int ms = 0; ms < 50 && !status_; ++ms) step();
    return status_ ? status_->position : INT64_MIN;
  }

 private:
  void send(const wire::Frame& frame) {
    uint8_t bytes[wire::kFrameMax];
    const uint8_t count = encode(frame, bytes);
    board_->receive({bytes, count});
  }
  void step() {
    if (++ms_ % 100 == 0) send(wire::pack(wire::Type::kHeartbeat, 0));
    board_->advance_to(board_->now_ns() / kNsPerMs * kNsPerMs + kNsPerMs);
    board_->take_steps();
    wire::Frame frame;
    for (const uint8_t byte : board_->take_transmitted()) {
      decoder_.push(byte);
      while (decoder_.take(frame)) take(frame);
    }
  }
  void take(const wire::Frame& frame) {
    wire::Ack ack;
    wire::Done done;
    wire::Status status;
    if (unpack(frame, ack) && frame.sequence == sequence_)
      refused_ = ack.reason != wire::Reason::kNone;
    if (unpack(frame, done) && frame.sequence == sequence_) done_ = done;
    if (unpack(frame, status)) status_ = status;
  }

  std::unique_ptr<AvrBoard> board_;
  wire::Decoder decoder_;
  uint8_t sequence_ = 0;
  int64_t ms_ = 0;
  bool refused_ = false;
  std::optional<wire::Done> done_;
  std::optional<wire::Status> status_;
};

class Sequences {
 public:
  Sequences(SteppedBoard& board, uint64_t seed) : board_(board), random_(seed) {}

  SequenceOutcome run(int64_t count) {
    for (number_ = 0; number_ < count; ++number_) {
      const int64_t orders = 1 + pick(4);
      for (int64_t i = 0; i < orders; ++i) one();
      if (board_.reported() != board_.pin()) wrong("the board's count is not the pin's", 0, 0);
    }
    return std::move(out_);
  }

 private:
  int64_t pick(int64_t below) {
    return static_cast<int64_t>(random_() % static_cast<uint64_t>(below));
  }
  static int64_t steps_of(int64_t um) { return (um * 420 + 500) / 1000; }

  void wrong(const char* what, int64_t expected, int64_t made) {
    if (out_.wrong++ > 0) return;
    out_.first = "sequence " + std::to_string(number_) + ": " + what + ", expected " +
                 std::to_string(expected) + ", made " + std::to_string(made);
  }
  void give(uint8_t m_code, int32_t argument) {
    ++out_.orders;
    if (!board_.order(m_code, argument)) wrong("an order was refused", m_code, argument);
  }

  void one() {
    const int64_t before = board_.pin();
    switch (pick(4)) {
      case 0:
        retract();
        break;
      case 1:
        counted();
        break;
      default:
        timed();
        break;
    }
    out_.steps += std::abs(board_.pin() - before);
  }

  // Back to a total of `um`, or nothing if more than that is retracted already.
  void retract() {
    const int64_t um = 10 + pick(800);
    const int64_t before = board_.pin();
    give(74, static_cast<int32_t>(um));
    give(75, 0);
    const int64_t further = std::max<int64_t>(0, steps_of(um) - retracted_);
    if (before - board_.pin() != further) wrong("a retraction", further, before - board_.pin());
    retracted_ += further;
  }

  void counted() {
    const int64_t um = 10 + pick(1000);
    const int64_t speed = 500 + pick(40'000);
    const int64_t before = board_.pin();
    ++out_.orders;
    if (!board_.extrude_length(static_cast<int32_t>(um), static_cast<int32_t>(speed)))
      return timed();
    const int64_t expected = retracted_ + steps_of(um);
    if (board_.pin() - before != expected)
      wrong("a counted length", expected, board_.pin() - before);
    retracted_ = 0;
  }

  void timed() {
    const int64_t speed = 100 + pick(30'000);
    const int64_t before = board_.pin();
    give(72, static_cast<int32_t>(speed));
    const int64_t begun = board_.pin();
    // Done is sent when extrusion begins; a step or two may be made while it is on the wire.
    const double rate = static_cast<double>(speed) * kStepsPerMm / 1e6;  // a millisecond
    const auto near = static_cast<int64_t>(rate * kWireMs) + 2;
    if (std::abs(begun - before - retracted_) > near) {
      wrong("a restored length", retracted_, begun - before);
    }
    const int64_t ms = pick(30);
    board_.run_ms(ms);
    give(73, 0);
    const double asked = rate * static_cast<double>(ms);
    const auto made = static_cast<double>(board_.pin() - before - retracted_);
    // Ramps are symmetrical: what the first loses the last makes up, unless full speed was not
    // reached. Millisecond looks, and the orders' own time on the wire.
    const double most = rate * (static_cast<double>(ms) + 2 * kWireMs + 4) + 4;
    const double ramp_ms = static_cast<double>(speed) / 200;  // 200 mm/s^2
    const double least = static_cast<double>(ms) > ramp_ms + 2 ? asked - rate * 4 - 4 : 0;
    if (made > most || made < least) {
      wrong("a timed extrusion", static_cast<int64_t>(asked), static_cast<int64_t>(made));
    }
    retracted_ = 0;
  }

  static constexpr double kWireMs = 3;

  SteppedBoard& board_;
  std::mt19937_64 random_;
  SequenceOutcome out_;
  int64_t number_ = 0;
  int64_t retracted_ = 0;  // steps
};

}  // namespace

std::unique_ptr<SteppedBoard> stepped_logic() {
  return std::make_unique<SteppedLogic>();
}

std::unique_ptr<SteppedBoard> stepped_avr(const std::filesystem::path& elf) {
  auto board = AvrBoard::open(elf);
  if (!board) return nullptr;
  return std::make_unique<SteppedAvr>(std::move(*board));
}

SequenceOutcome run_step_sequences(SteppedBoard& board, int64_t count, uint64_t seed) {
  return Sequences(board, seed).run(count);
}

}  // namespace reforge
