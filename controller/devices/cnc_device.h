// A CNC controller's dialect behind one small interface: bytes -> typed events, words -> bytes.
//
// A dialect holds no time and no policy; it says by its capabilities what can be known. GRBL is
// built (cnc_grbl.h); Marlin (numbered lines, ping-pong, Resend) and the Fanuc-like drip (XON/XOFF,
// nothing acknowledged) fit the same face.
// Units: mm and degrees as the controller reports them, mm/min, rpm.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "controller/core/program.h"
#include "protocols/result.h"

namespace reforge {

struct CncCapabilities {
  bool knows_position;
  bool knows_drained;   // can say that motion has really finished
  bool knows_errors;    // acknowledges or rejects each line
  bool real_time_hold;  // a hold that overtakes the stream
  bool runs_m_codes;    // M70-M75 may be passed on
};

// How many bytes or lines may be unacknowledged.
struct FlowControl {
  enum class Kind : std::uint8_t { kCharacterCount, kLineWindow, kXonXoff };
  Kind kind;
  int window;  // bytes, or lines; meaningless for kXonXoff
};

enum class CncRunState : std::uint8_t {
  kUnknown,
  kIdle,
  kRun,
  kHolding,
  kHeld,
  kJog,
  kHome,
  kDoor,
  kAlarm,
  kCheck,
  kSleep,
  kTool,
};
std::string_view name(CncRunState state);

constexpr int kCncAxesMax = 6;

struct CncStatus {
  CncRunState state = CncRunState::kUnknown;
  int axes = 0;
  std::array<double, kCncAxesMax> machine_position{};  // in the controller's axis order
  bool has_position = false;
  double feed_mm_per_min = 0;
  double spindle_rpm = 0;
};

namespace cnc {

struct Acknowledged {};  // one line parsed and queued
struct Rejected {
  int code;
  std::string sentence;
};  // error:N
struct Alarm {
  int code;
  std::string sentence;
};  // ALARM:N
struct Banner {
  std::string text;
};                         // the controller has just (re)started
struct Identity {          // part of the answer to identify()
  std::string version;     // empty when this part does not say
  std::string axes;        // "XYZBC"; empty when this part does not say
  int receive_buffer = 0;  // 0 when this part does not say
};
struct WorkOffset {
  std::string name;
  int axes;
  std::array<double, kCncAxesMax> offset;
};  // "G54"
struct Message {
  std::string text;
};
struct Garbage {
  std::string text;
};  // not in the dialect, cut to 80 bytes
struct Resend {
  LineNumber line;
};  // Marlin

}  // namespace cnc

using CncReport =
    std::variant<cnc::Acknowledged, cnc::Rejected, cnc::Alarm, cnc::Banner, cnc::Identity,
                 cnc::WorkOffset, cnc::Message, cnc::Garbage, cnc::Resend, CncStatus>;

class CncDevice {
 public:
  virtual ~CncDevice() = default;

  virtual CncCapabilities capabilities() const = 0;
  virtual FlowControl flow() const = 0;

  // Events in the order of their bytes. Splits of the stream do not matter.
  virtual std::vector<CncReport> receive(std::string_view bytes) = 0;
  virtual void forget() = 0;  // the port was opened: an unfinished line is not continued

  // One line as it goes on the wire, its end included; or why it cannot go.
  virtual Result<std::string> encode(std::string_view words, LineNumber line) const = 0;

  // Requests; an empty string means the dialect has none.
  virtual std::string hold() const = 0;
  virtual std::string resume() const = 0;
  virtual std::string reset() const = 0;
  virtual std::string status_query() const = 0;
  virtual std::string identify() const = 0;     // answered by Identity events, then Acknowledged
  virtual std::string ask_offsets() const = 0;  // answered by WorkOffset events, then Acknowledged
  virtual std::string unlock() const = 0;       // leave Alarm without homing
  virtual std::string_view drain_words() const = 0;  // acknowledged once motion before it is over
};

}  // namespace reforge
