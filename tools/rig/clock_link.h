// The rig's end of the clock link (FORMATS.md, "Clock link"): one daemon at a time takes its time
// from us. Only the protocol: lines out, lines in, non-blocking. When to tick is rig_server's
// affair.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocols/result.h"
#include "tools/rig/unix_listener.h"

namespace reforge {

// A line `D`: byte counts are the daemon's.
struct ClockAnswer {
  uint64_t tick;
  int64_t deadline_ns;
  uint64_t cnc_in, cnc_out;
  uint64_t extruder_in, extruder_out;
};

// Nothing when the line is not as FORMATS.md says.
std::optional<ClockAnswer> parse_clock_answer(std::string_view line);

class ClockLink {
 public:
  static Result<ClockLink> listen(const std::filesystem::path& file);

  bool connected() const { return static_cast<bool>(daemon_); }
  // Takes a waiting daemon if there is none; true if one has just connected.
  bool accept();
  void drop();

  // Number of the tick sent last on this connection; 0 before the first.
  uint64_t tick() const { return tick_; }
  void send_tick(int64_t now_ns, uint64_t cnc_out, uint64_t extruder_out);
  // Whole lines that have come. A daemon that hangs up or talks nonsense is dropped; why() says so.
  std::vector<ClockAnswer> take();
  const std::string& why() const { return why_; }

  int listener_fd() const { return listener_.fd(); }
  int daemon_fd() const { return daemon_.get(); }

 private:
  explicit ClockLink(UnixListener listener) : listener_(std::move(listener)) {}
  UnixListener listener_;
  FileHandle daemon_;
  uint64_t tick_ = 0;
  std::string received_;
  std::string why_;
};

}  // namespace reforge
