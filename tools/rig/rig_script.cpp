#include "tools/rig/rig_script.h"

#include <charconv>
#include <cmath>
#include <optional>
#include <sstream>
#include <utility>

namespace reforge {
namespace {

using Kind = RigAction::Kind;

constexpr std::pair<std::string_view, Kind> kWireFaults[] = {
    {"drop", Kind::kDrop},   {"flip", Kind::kFlip},   {"duplicate", Kind::kDuplicate},
    {"stall", Kind::kStall}, {"delay", Kind::kDelay}, {"noise", Kind::kNoise}};
constexpr std::pair<std::string_view, BoardMishap> kMishaps[] = {
    {"reset", BoardMishap::kReset},
    {"brown-out", BoardMishap::kBrownOut},
    {"power-cycle", BoardMishap::kPowerCycle},
    {"hang", BoardMishap::kHang},
    {"sensor-ok", BoardMishap::kSensorConnected},
    {"sensor-open", BoardMishap::kSensorOpen},
    {"sensor-short", BoardMishap::kSensorShort},
    {"sensor-fallen-out", BoardMishap::kSensorFallenOut},
    {"heater-broken", BoardMishap::kHeaterBroken},
    {"filament-out", BoardMishap::kFilamentOut},
    {"filament-in", BoardMishap::kFilamentIn}};
constexpr std::pair<std::string_view, CncButton> kButtons[] = {
    {"hold", CncButton::kHold},          {"start", CncButton::kStart},
    {"reset", CncButton::kReset},        {"home", CncButton::kHome},
    {"door-open", CncButton::kDoorOpen}, {"door-close", CncButton::kDoorClose}};

template <typename Value, size_t kSize>
bool choose(const std::pair<std::string_view, Value> (&table)[kSize], std::string_view word,
            Value& value) {
  for (const auto& [name, meaning] : table) {
    if (name == word) return value = meaning, true;
  }
  return false;
}

constexpr double kNone = -1;

// Not negative; kNone when it is no number of a script.
double number(std::string_view text) {
  if (text.starts_with('+')) text.remove_prefix(1);
  double value = 0;
  const auto read = std::from_chars(text.data(), text.data() + text.size(), value);
  if (read.ec != std::errc{} || read.ptr != text.data() + text.size()) return kNone;
  if (!std::isfinite(value) || value < 0 || value > 1e9) return kNone;
  return value;
}

int64_t to_ns(double seconds) {
  return std::llround(seconds * 1e9);
}

bool noise_word(std::string_view word, WireNoise& noise) {
  const size_t equals = word.find('=');
  if (equals == std::string_view::npos) return false;
  const std::string_view key = word.substr(0, equals);
  const double value = number(word.substr(equals + 1));
  if (value == kNone) return false;
  if (key == "delay") return noise.delay_ns = to_ns(value), true;
  double* const chance = key == "drop"        ? &noise.drop
                         : key == "flip"      ? &noise.flip
                         : key == "duplicate" ? &noise.duplicate
                                              : nullptr;
  if (!chance || value > 1) return false;
  *chance = value;
  return true;
}

// Words from `at` on; the sentence says what is wrong with them.
std::optional<std::string> read_action(const std::vector<std::string>& words, size_t at,
                                       RigAction& action) {
  const auto word = [&](size_t i) { return at + i < words.size() ? words[at + i] : ""; };
  const size_t count = words.size() - std::min(at, words.size());
  for (size_t i = 0; i < count; ++i) action.text += (i ? " " : "") + word(i);
  if (word(0) == "board" && count == 2) {
    action.kind = Kind::kBoard;
    if (choose(kMishaps, word(1), action.mishap)) return std::nullopt;
    return "the board knows no " + word(1);
  }
  if (word(0) == "panel" && count == 2) {
    action.kind = Kind::kPanel;
    if (choose(kButtons, word(1), action.button)) return std::nullopt;
    return "the CNC's panel has no " + word(1);
  }
  if (word(0) == "swap-ports" && count == 2) {
    action.kind = Kind::kSwapPorts;
    action.amount = number(word(1));
    if (action.amount == kNone) return "swap-ports wants seconds";
    return std::nullopt;
  }
  if (word(0) != "cnc" && word(0) != "extruder") {
    return "there is no action \"" + action.text + "\"";
  }
  action.link = word(0) == "cnc" ? Link::kCnc : Link::kExtruder;
  if (word(1) == "unplug" && count == 3) {
    action.kind = Kind::kUnplug;
    action.amount = number(word(2));
    if (action.amount == kNone) return "unplug wants seconds";
    return std::nullopt;
  }
  if (word(1) != "both" && word(1) != "to-host" && word(1) != "to-device") {
    return "after " + word(0) + " comes unplug, both, to-host or to-device";
  }
  action.to_host = word(1) != "to-device";
  action.to_device = word(1) != "to-host";
  if (!choose(kWireFaults, word(2), action.kind)) return "a wire knows no " + word(2);
  if (action.kind == Kind::kNoise) {
    for (size_t i = 3; i < count; ++i) {
      if (!noise_word(word(i), action.noise)) return "noise knows no " + word(i);
    }
    return std::nullopt;
  }
  action.amount = number(word(3));
  if (action.amount == kNone || count != 4) return word(2) + " wants one number";
  return std::nullopt;
}

}  // namespace

Result<RigScript> RigScript::parse(std::string_view text, const std::string& name_for_errors) {
  RigScript script;
  std::istringstream lines{std::string(text)};
  std::string line;
  for (int n = 1; std::getline(lines, line); ++n) {
    if (const size_t comment = line.find('#'); comment != std::string::npos) line.erase(comment);
    std::istringstream split(line);
    std::vector<std::string> words;
    for (std::string word; split >> word;) words.push_back(word);
    if (words.empty()) continue;
    const auto wrong = [&](const std::string& what) {
      return Error{Code::kUsage,
                   name_for_errors + ", line " + std::to_string(n) + ": " + what + "."};
    };
    const double second = words.size() > 1 ? number(words[1]) : kNone;
    if (words[0] == "seed" && words.size() == 2 && second != kNone) {
      script.seed_ = static_cast<uint64_t>(second);
      continue;
    }
    Entry entry;
    size_t action_at = 2;
    if (words[0] == "at" && second != kNone) {
      entry.due_ns = to_ns(second);
    } else if (words[0] == "on" && words.size() > 3) {
      const double count = number(words[2]);
      if (count < 1) return wrong("on wants an event and which of them, from 1");
      entry.event = words[1];
      entry.count = static_cast<int>(count);
      action_at = 3;
      if (words[3].starts_with('+')) {
        const double delay = number(words[3]);
        if (delay == kNone) return wrong(words[3] + " is no time");
        entry.delay_ns = to_ns(delay);
        action_at = 4;
      }
    } else {
      return wrong("a line begins with seed N, at SECONDS or on EVENT N");
    }
    if (const auto bad = read_action(words, action_at, entry.action)) return wrong(*bad);
    script.entries_.push_back(std::move(entry));
  }
  return script;
}

void RigScript::note(std::string_view event, int64_t now_ns) {
  for (Entry& entry : entries_) {
    if (entry.count == 0 || entry.event != event) continue;
    if (--entry.count == 0) entry.due_ns = now_ns + entry.delay_ns;
  }
}

std::vector<RigAction> RigScript::take_due(int64_t now_ns) {
  std::vector<RigAction> due;
  for (Entry& entry : entries_) {
    if (entry.done || entry.due_ns > now_ns) continue;
    entry.done = true;
    due.push_back(entry.action);
  }
  return due;
}

bool RigScript::waiting() const {
  for (const Entry& entry : entries_) {
    if (!entry.done) return true;
  }
  return false;
}

}  // namespace reforge
