// A host's end of the link for tests against the real firmware under simavr: sends frames, keeps
// the heartbeat, collects what comes back with its time. Virtual time throughout.
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "protocols/extruder_wire.h"
#include "tools/rig/avr_board.h"

namespace reforge {

constexpr int64_t kMs = 1'000'000;

class Bench {
 public:
  // Boots the board and takes its banner.
  Bench();
  // ... and says hello.
  static Bench greeted();

  AvrBoard& board() { return *board_; }
  int64_t now_ms() const { return board_->now_ns() / kMs; }

  void send(const wire::Frame& frame);
  void send_text(const std::string& text);
  uint8_t order(const wire::Frame& frame);  // with the next order's sequence, which it returns
  uint8_t command(uint8_t m_code, int32_t argument = wire::kUseSetting);
  void set(wire::Setting id, int32_t value);  // and expects it to be taken

  void run_ms(int64_t ms);  // heartbeats every 100 ms unless silent
  void silence(bool silent) { silent_ = silent; }

  // The next frame of this type, dropping others; none within the time is nullopt.
  std::optional<wire::Frame> await(wire::Type type, int64_t within_ms);
  wire::Ack await_ack(int64_t within_ms = 10);
  wire::Done await_done(int64_t within_ms);
  wire::Status status();
  std::string take_text() { return std::exchange(text_, {}); }
  // M70 to 205 C on a hot end that is nearly there already.
  void open_hot();

 private:
  void step_ms();

  std::unique_ptr<AvrBoard> board_;
  wire::Decoder decoder_;
  std::deque<wire::Frame> frames_;
  std::string text_;
  uint8_t order_ = 0;
  uint8_t question_ = 100;
  bool silent_ = true;
  int64_t next_beat_ms_ = 0;
};

}  // namespace reforge
