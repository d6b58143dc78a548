#include "firmware/arduino-extruder/terminal.h"

#include "firmware/arduino-extruder/flash.h"

namespace reforge {
namespace firmware {
namespace {

using wire::Reason;

constexpr char kOk[] REFORGE_FLASH = "ok\n";
constexpr char kError[] REFORGE_FLASH = "error ";
constexpr char kState[] REFORGE_FLASH = "state=";
constexpr char kFault[] REFORGE_FLASH = " fault=";
constexpr char kTemperature[] REFORGE_FLASH = " temp=";
constexpr char kSteps[] REFORGE_FLASH = " steps=";
constexpr char kEnd[] REFORGE_FLASH = "\n";

bool digit(char c) {
  return c >= '0' && c <= '9';
}

}  // namespace

void Terminal::receive(uint8_t byte, uint32_t now_ms) {
  if (byte == '\n' || byte == '\r') {
    const bool too_long = length_ > kLineMax;
    const bool empty = length_ == 0;
    if (!too_long) line_[length_] = 0;
    length_ = 0;
    if (empty) return;
    if (too_long) {
      answer(Reason::kUnknownCommand);
    } else {
      line(now_ms);
    }
  } else if (byte != ' ' && length_ <= kLineMax) {
    const char upper = static_cast<char>(byte >= 'a' && byte <= 'z' ? byte - 'a' + 'A' : byte);
    if (length_ < kLineMax) line_[length_] = upper;
    ++length_;
  }
}

void Terminal::line(uint32_t now_ms) {
  if (line_[0] == '?' && line_[1] == 0) {
    extruder_.refresh(Authority::kTerminal, now_ms);
    return state();
  }
  // M70-M75 alone mean anything with an order under way.
  Reason reason = Reason::kUnknownCommand;
  bool order = false;
  if (line_[0] == 'M' && line_[1] == '7' && line_[2] >= '0' && line_[2] <= '5' &&
      !digit(line_[3])) {
    extruder_.refresh(Authority::kTerminal, now_ms);
    const bool stops = line_[2] == '1' || line_[2] == '3';
    if (stops || !settings_.get(wire::Setting::kInStream)) {
      reason = waiting_ && !stops ? Reason::kBusy : m_code(now_ms);
    } else {
      reason = Reason::kInStreamOnly;
    }
    order = true;
  } else if (line_[0] == 'C' && line_[1] == 'L' && line_[2] == 'E' && line_[3] == 'A' &&
             line_[4] == 'R' && line_[5] == 0) {
    extruder_.refresh(Authority::kTerminal, now_ms);
    reason = waiting_ ? Reason::kBusy : extruder_.clear_fault(now_ms);
  }
  if (reason != Reason::kNone || !order) return answer(reason);
  if (waiting_) answer(Reason::kSuperseded);
  waiting_ = true;
}

Reason Terminal::m_code(uint32_t now_ms) {
  const uint8_t code = static_cast<uint8_t>(70 + line_[2] - '0');
  int32_t value = 0;
  if (code == 72) {
    int32_t speed = wire::kUseSetting;
    word('F', speed);
    if (!word('L', value)) return Reason::kBadArgument;
    return extruder_.extrude_length(value, speed);
  }
  if (code == 70 && word('S', value)) value /= 100;  // thousandths to tenths
  if (code == 74) word('L', value);
  return extruder_.command(code, value, now_ms);
}

// The number behind a letter, in thousandths (a millimetre's are micrometres); false when there is
// none.
bool Terminal::word(char letter, int32_t& thousandths) const {
  const char* at = line_ + 3;
  while (*at != letter) {
    if (*at == 0) return false;
    ++at;
  }
  ++at;
  if (!digit(*at)) return false;
  int32_t value = 0;
  uint8_t decimals = 0;
  bool point = false;
  for (; digit(*at) || (*at == '.' && !point); ++at) {
    if (*at == '.') {
      point = true;
    } else if (decimals < 3 && value < 10000000) {
      value = value * 10 + (*at - '0');
      if (point) ++decimals;
    }
  }
  for (; decimals < 3; ++decimals) value *= 10;
  thousandths = value;
  return true;
}

void Terminal::finished(Reason reason) {
  waiting_ = false;
  answer(reason);
}

void Terminal::answer(Reason reason) {
  if (reason == Reason::kNone) return print(kOk);
  print(kError);
  print(static_cast<int32_t>(reason));
  print(kEnd);
}

void Terminal::state() {
  print(kState);
  print(static_cast<int32_t>(extruder_.state()));
  print(kFault);
  print(static_cast<int32_t>(extruder_.fault()));
  print(kTemperature);
  const int16_t tenths = extruder_.temperature();
  if (tenths == wire::kTemperatureUnknown) {
    out_.push('?');
  } else {
    print(static_cast<int32_t>(tenths / 10));
  }
  print(kSteps);
  print(extruder_.position());
  print(kEnd);
}

void Terminal::print(const char* text) {
  for (char c; (c = static_cast<char>(flash_u8(text))) != 0; ++text) {
    out_.push(static_cast<uint8_t>(c));
  }
}

void Terminal::print(int32_t number) {
  char digits[11];
  uint8_t count = 0;
  uint32_t rest = number < 0 ? 0 - static_cast<uint32_t>(number) : static_cast<uint32_t>(number);
  do {
    digits[count++] = static_cast<char>('0' + rest % 10);
    rest /= 10;
  } while (rest > 0);
  if (number < 0) out_.push('-');
  while (count > 0) out_.push(static_cast<uint8_t>(digits[--count]));
}

}  // namespace firmware
}  // namespace reforge
