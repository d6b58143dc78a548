// The extruder board's port for a person's manual commands: one conversation (protocols/
// extruder_wire.h), which waits for its answers and keeps the heartbeat meanwhile.
//
// The port is held exclusively, as the daemon holds it: whoever comes second is refused. Opening it
// resets a UNO, unless the program before has left it otherwise; then its banner is awaited.
// Units: the wire's (0.1 C, um, um/s, ms).
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <optional>
#include <utility>

#include "protocols/extruder_wire.h"
#include "protocols/result.h"

namespace reforge {

class ExtruderPort {
 public:
  using Milliseconds = std::chrono::milliseconds;

  static Result<ExtruderPort> open(const std::filesystem::path& port);
  ExtruderPort(ExtruderPort&& other) noexcept;
  ExtruderPort& operator=(ExtruderPort&&) = delete;
  ~ExtruderPort();

  const wire::Banner& banner() const { return banner_; }

  // An order to its end; the error is the board's own sentence, or that it went silent.
  Status order(const wire::Frame& frame, Milliseconds within);
  Status m_code(int code, std::int32_t argument, Milliseconds within);
  Result<wire::Status> status();
  Result<std::int32_t> setting(wire::Setting id);
  // Lets time pass with the heartbeat kept; ends early with the board's fault.
  Status keep(Milliseconds time);

 private:
  using Clock = std::chrono::steady_clock;
  explicit ExtruderPort(int fd) : fd_(fd) {}
  Status greet();
  Status send(const wire::Frame& frame);
  Status read_some(int within_ms);
  // The next frame of these types; others but faults are dropped.
  Result<std::optional<wire::Frame>> await(wire::Type type, Milliseconds within,
                                           std::optional<wire::Type> or_type = std::nullopt);

  int fd_ = -1;
  wire::Decoder decoder_;
  std::deque<wire::Frame> inbox_;
  wire::Banner banner_{};
  std::uint8_t sequence_ = 0;
  std::uint8_t question_ = 0;
  Clock::time_point next_beat_{};
  bool beating_ = false;
};

}  // namespace reforge
