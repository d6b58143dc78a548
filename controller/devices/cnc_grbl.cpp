#include "controller/devices/cnc_grbl.h"

#include <charconv>
#include <cmath>
#include <iterator>

namespace reforge {

namespace {

constexpr std::size_t kReportMax = 256;  // no report of the dialect is longer
constexpr std::size_t kGarbageShown = 80;
constexpr int kReceiveBufferMax = 1 << 16;

// grbl wiki, "Grbl v1.1 Interface", error codes.
constexpr std::string_view kErrors[] = {
    "",
    "a G-code word has no letter",
    "a number is missing or malformed",
    "the '$' command is not known",
    "a value is negative that must not be",
    "homing is not enabled in the settings",
    "the step pulse must be at least 3 microseconds",
    "its EEPROM could not be read; defaults were restored",
    "the '$' command needs the controller to be Idle",
    "it is locked by an alarm or a jog",
    "soft limits need homing to be enabled",
    "the line is longer than it takes",
    "the step rate of the settings is too high",
    "the safety door is open",
    "the start-up line or build info is too long",
    "the jog's target exceeds the travel",
    "the jog command has no '=' or holds a forbidden word",
    "laser mode needs a PWM output",
    "",
    "",
    "a word or code is not supported",
    "two codes of one modal group stand in one block",
    "no feed rate has been set",
    "a code needs a whole number",
    "two codes that need axis words stand in one block",
    "a word is repeated in one block",
    "the code needs axis words",
    "the line number is out of range",
    "a word needed by the code is missing",
    "G59.1 to G59.3 are not supported",
    "G53 is allowed with G0 and G1 only",
    "axis words stand in a block that uses none",
    "an arc has no axis word in its plane",
    "the motion's target is not valid",
    "the arc's radius cannot be computed",
    "an arc has no offset in its plane",
    "words are left over that the block does not use",
    "a tool length offset is not on its configured axis",
    "the tool number is too large",
};

constexpr std::string_view kAlarms[] = {
    "",
    "a limit switch was hit; the position is probably lost: home again",
    "the target exceeds the machine's travel; the position is kept",
    "reset while in motion; the position is lost: home again",
    "the probe was not in its start state",
    "the probe did not touch",
    "homing failed: reset during homing",
    "homing failed: the safety door was opened",
    "homing failed: the limit switch did not release",
    "homing failed: no limit switch was found",
};

struct NamedState {
  std::string_view text;
  CncRunState state;
};
constexpr NamedState kStates[] = {
    {"Idle", CncRunState::kIdle},   {"Run", CncRunState::kRun},     {"Jog", CncRunState::kJog},
    {"Home", CncRunState::kHome},   {"Alarm", CncRunState::kAlarm}, {"Check", CncRunState::kCheck},
    {"Sleep", CncRunState::kSleep}, {"Tool", CncRunState::kTool},
};

std::string meaning(int code, const std::string_view* table, std::size_t size) {
  const auto index = static_cast<std::size_t>(code);
  if (code <= 0 || index >= size || table[index].empty()) return "a code unknown to us";
  return std::string(table[index]);
}

bool take_prefix(std::string_view& text, std::string_view prefix) {
  if (text.substr(0, prefix.size()) != prefix) return false;
  text.remove_prefix(prefix.size());
  return true;
}

// The text up to the separator (or all of it), taken off the front.
std::string_view take_field(std::string_view& text, char separator) {
  const std::size_t at = text.find(separator);
  const std::string_view field = text.substr(0, at);
  text.remove_prefix(at == std::string_view::npos ? text.size() : at + 1);
  return field;
}

template <typename Number>
bool parse_number(std::string_view text, Number& out) {
  const char* end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, out);
  return error == std::errc{} && stop == end;
}

// "1.000,2.000,..." of 1 to kCncAxesMax finite numbers; 0 if it is anything else.
int parse_axes(std::string_view text, std::array<double, kCncAxesMax>& out) {
  int count = 0;
  while (!text.empty()) {
    double value = 0;
    if (count == kCncAxesMax || !parse_number(take_field(text, ','), value) ||
        !std::isfinite(value)) {
      return 0;
    }
    out[static_cast<std::size_t>(count++)] = value;
  }
  return count;
}

std::optional<CncRunState> parse_state(std::string_view text) {
  const std::string_view main = take_field(text, ':');  // leaves the sub-state
  if (main == "Hold") return text == "0" ? CncRunState::kHeld : CncRunState::kHolding;
  if (main == "Door") return CncRunState::kDoor;
  for (const NamedState& known : kStates) {
    if (known.text == main) return known.state;
  }
  return std::nullopt;
}

// "<Idle|MPos:0.000,...|FS:0,0|WCO:...>"
std::optional<CncStatus> parse_status(std::string_view text) {
  if (text.size() < 2 || text.front() != '<' || text.back() != '>') return std::nullopt;
  text = text.substr(1, text.size() - 2);
  const auto state = parse_state(take_field(text, '|'));
  if (!state) return std::nullopt;
  CncStatus status;
  status.state = *state;
  while (!text.empty()) {
    std::string_view field = take_field(text, '|');
    if (take_prefix(field, "MPos:")) {
      status.axes = parse_axes(field, status.machine_position);
      if (status.axes == 0) return std::nullopt;
      status.has_position = true;
    } else if (take_prefix(field, "FS:")) {
      if (!parse_number(take_field(field, ','), status.feed_mm_per_min) ||
          !parse_number(take_field(field, ','), status.spindle_rpm)) {
        return std::nullopt;
      }
    }
  }
  return status;
}

// "[VER:1.1f.20230926:]", "[OPT:VN,35,1024]", "[AXS:5:XYZBC]", "[G54:0.000,...]", "[MSG:...]"
std::optional<CncReport> parse_feedback(std::string_view text) {
  if (text.size() < 2 || text.front() != '[' || text.back() != ']') return std::nullopt;
  text = text.substr(1, text.size() - 2);
  if (take_prefix(text, "VER:")) return cnc::Identity{std::string(text), "", 0};
  if (take_prefix(text, "AXS:")) {
    take_field(text, ':');
    if (text.empty()) return std::nullopt;
    return cnc::Identity{"", std::string(text), 0};
  }
  if (take_prefix(text, "OPT:")) {
    take_field(text, ',');
    take_field(text, ',');
    int bytes = 0;
    if (!parse_number(take_field(text, ','), bytes) || bytes <= 0 || bytes > kReceiveBufferMax) {
      bytes = 0;
    }
    return cnc::Identity{"", "", bytes};
  }
  if (text.size() >= 4 && text[0] == 'G' && text[1] == '5' && text[3] == ':') {
    cnc::WorkOffset offset{std::string(text.substr(0, 3)), 0, {}};
    offset.axes = parse_axes(text.substr(4), offset.offset);
    if (offset.axes == 0) return std::nullopt;
    return offset;
  }
  return cnc::Message{std::string(text)};
}

CncReport parse_line(std::string_view text) {
  std::string_view rest = text;
  int code = 0;
  if (text == "ok") return cnc::Acknowledged{};
  if (take_prefix(rest, "error:") && parse_number(rest, code)) {
    return cnc::Rejected{code, grbl_error_sentence(code)};
  }
  rest = text;
  if (take_prefix(rest, "ALARM:") && parse_number(rest, code)) {
    return cnc::Alarm{code, grbl_alarm_sentence(code)};
  }
  if (text.front() == '<') {
    if (auto status = parse_status(text)) return *status;
  } else if (text.front() == '[') {
    if (auto feedback = parse_feedback(text)) return *feedback;
  } else if (text.substr(0, 5) == "Grbl " || text.substr(0, 7) == "GrblHAL") {
    return cnc::Banner{std::string(text)};
  }
  return cnc::Garbage{std::string(text.substr(0, kGarbageShown))};
}

}  // namespace

std::string grbl_error_sentence(int code) {
  return "error:" + std::to_string(code) + ", " + meaning(code, kErrors, std::size(kErrors));
}

std::string grbl_alarm_sentence(int code) {
  return "ALARM:" + std::to_string(code) + ", " + meaning(code, kAlarms, std::size(kAlarms));
}

CncGrbl::CncGrbl(const CncLink& link) : link_(link) {}

CncCapabilities CncGrbl::capabilities() const {
  return {.knows_position = true,
          .knows_drained = true,
          .knows_errors = true,
          .real_time_hold = true,
          .runs_m_codes = link_.m_codes == MCodeRoute::kInStream};
}

FlowControl CncGrbl::flow() const {
  return {FlowControl::Kind::kCharacterCount, link_.receive_buffer_bytes};
}

void CncGrbl::forget() {
  line_.clear();
  overlong_ = false;
}

std::vector<CncReport> CncGrbl::receive(std::string_view bytes) {
  std::vector<CncReport> events;
  for (const char c : bytes) {
    if (c == '\n' || c == '\r') {
      if (overlong_) {
        events.push_back(cnc::Garbage{line_.substr(0, kGarbageShown)});
      } else if (!line_.empty()) {
        events.push_back(parse_line(line_));
      }
      forget();
    } else if (line_.size() >= kReportMax) {
      overlong_ = true;
    } else {
      line_ += c;
    }
  }
  return events;
}

Result<std::string> CncGrbl::encode(std::string_view words, LineNumber line) const {
  const auto refuse = [&](const std::string& why) {
    return Result<std::string>::fail(Code::kMalformed, "Line " + std::to_string(line) + " " + why);
  };
  // Any of these in a line would act as a command of its own instead of being part of the line.
  for (const char c : words) {
    const auto byte = static_cast<unsigned char>(c);
    if (byte < 0x20 || byte >= 0x7F || c == '?' || c == '!' || c == '~' || c == '$') {
      return refuse("holds a byte the CNC would take as a command of its own (0x" +
                    std::string(1, "0123456789ABCDEF"[byte >> 4]) +
                    std::string(1, "0123456789ABCDEF"[byte & 15]) + ").");
    }
  }
  if (static_cast<int>(words.size()) + 1 > link_.line_length_max) {
    return refuse("has " + std::to_string(words.size() + 1) +
                  " bytes with its end; the CNC takes at most " +
                  std::to_string(link_.line_length_max) + ".");
  }
  return std::string(words) + '\n';
}

std::string CncGrbl::hold() const {
  return "!";
}
std::string CncGrbl::resume() const {
  return "~";
}
std::string CncGrbl::reset() const {
  return "\x18";
}
std::string CncGrbl::status_query() const {
  return "?";
}
std::string CncGrbl::identify() const {
  return "$I\n";
}
std::string CncGrbl::ask_offsets() const {
  return "$#\n";
}
std::string CncGrbl::unlock() const {
  return "$X\n";
}
std::string_view CncGrbl::drain_words() const {
  return "G4P0.01";
}

}  // namespace reforge
