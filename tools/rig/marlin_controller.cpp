#include "tools/rig/marlin_controller.h"

#include <algorithm>
#include <cassert>
#include <charconv>
#include <cstdio>
#include <utility>

namespace reforge {
namespace {

constexpr size_t kQueue = 4;
constexpr int64_t kLineNs = 400'000;
constexpr int64_t kBusyNs = 2 * kNsPerSecond;

unsigned checksum(std::string_view text) {
  unsigned sum = 0;
  for (const char c : text) sum ^= static_cast<unsigned char>(c);
  return sum;
}

template <typename Number>
bool whole_number(std::string_view text, Number& value) {
  const auto read = std::from_chars(text.data(), text.data() + text.size(), value);
  return read.ec == std::errc{} && read.ptr == text.data() + text.size();
}

std::string without_blanks(std::string_view text) {
  std::string out;
  for (const char c : text) {
    if (c > ' ') out += c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
  }
  return out;
}

}  // namespace

MarlinController::MarlinController(const RigDescription& rig, bool homed, bool hold_input)
    : receive_buffer_bytes_(rig.cnc.receive_buffer_bytes),
      line_length_max_(std::min<size_t>(95, static_cast<size_t>(rig.cnc.line_length_max))),
      executor_(rig, 1e-3, BlockExecutor::BeyondTravel::kClamp),
      hold_input_(hold_input) {
  (void)homed;  // Marlin moves unhomed axes as if they were at home
  restart();
}

void MarlinController::restart() {
  rx_.clear();
  line_.clear();
  queue_.clear();
  last_line_ = 0;
  executing_ = draining_ = killed_ = losing_ = false;
  send("start");
  send("echo:Marlin 2.1.2");
}

void MarlinController::advance_to(int64_t ns) {
  assert(ns >= now_);
  while (true) {
    const int64_t next = std::min(next_event_ns(), ns);
    now_ = std::max(now_, next);
    executor_.advance_to(now_);
    pump();
    if (next_event_ns() > ns) break;
  }
  now_ = ns;
  executor_.advance_to(now_);
}

int64_t MarlinController::next_event_ns() const {
  int64_t next = executor_.next_event_ns();
  if (killed_) return next;
  if (executing_) next = std::min(next, busy_ns_);
  if (!executing_ && !queue_.empty() && ready_ns_ > now_) next = std::min(next, ready_ns_);
  return next;
}

void MarlinController::receive(std::string_view bytes) {
  for (const char c : bytes) {
    if (killed_) return;
    if (static_cast<int>(rx_.size()) >= receive_buffer_bytes_) {
      if (!std::exchange(losing_, true)) {
        executor_.event(CncEvent::Kind::kFault, 0, "the receive buffer overflowed: bytes lost");
      }
      continue;
    }
    losing_ = false;
    rx_.push_back(c);
    pump();
  }
}

void MarlinController::pump() {
  while (!killed_) {
    if (executing_) {
      const bool over = draining_ ? executor_.drained() : executor_.ready_for_block();
      if (over) {
        executing_ = draining_ = false;
        executor_.take_end();
        send("ok");
        ready_ns_ = now_ + kLineNs;
        continue;
      }
      if (now_ >= busy_ns_) {
        send("echo:busy: processing");
        busy_ns_ = now_ + kBusyNs;
      }
    }
    const bool waits = !queue_.empty() && queue_.front() == "G28" && !executor_.drained();
    if (!executing_ && !queue_.empty() && !waits && now_ >= ready_ns_ &&
        executor_.ready_for_block()) {
      begin_command();
      continue;
    }
    if (rx_.empty() || queue_.size() >= kQueue) return;
    const char c = rx_.front();
    rx_.pop_front();
    if (c == '\n' || c == '\r') {
      take_line();
    } else if (line_.size() < line_length_max_) {
      line_ += c;
    }
  }
}

void MarlinController::take_line() {
  std::string text = std::exchange(line_, {});
  if (const size_t comment = text.find(';'); comment != std::string::npos) text.erase(comment);
  const size_t first = text.find_first_not_of(' ');
  if (first == std::string::npos) return;
  text.erase(0, first);
  if (without_blanks(text).starts_with("M112")) {
    killed_ = true;
    executor_.clear();
    return send("Error:Printer halted. kill() called!");
  }
  const size_t star = text.rfind('*');
  int64_t number = -1;
  if (text[0] == 'N') {
    const size_t end = text.find_first_not_of("0123456789", 1);
    const bool sound = whole_number(std::string_view(text).substr(1, end - 1), number);
    if (star == std::string::npos) return refuse("No Checksum with line number");
    unsigned sum = 256;
    if (!whole_number(without_blanks(std::string_view(text).substr(star + 1)), sum) ||
        sum != checksum(std::string_view(text).substr(0, star)) || !sound) {
      return refuse("checksum mismatch");
    }
    text = text.substr(end, star - end);
    if (without_blanks(text).starts_with("M110")) {
      last_line_ = number;
    } else if (number != last_line_ + 1) {
      return refuse("Line Number is not Last Line Number+1");
    }
    last_line_ = number;
  } else if (star != std::string::npos) {
    return refuse("No Line Number with checksum");
  }
  if (queue_.empty() && !executing_) ready_ns_ = now_ + kLineNs;
  queue_.push_back(without_blanks(text));
}

void MarlinController::refuse(const char* why) {
  send(std::string("Error:") + why + ", Last Line: " + std::to_string(last_line_));
  rx_.clear();
  send("Resend: " + std::to_string(last_line_ + 1));
  send("ok");
}

void MarlinController::begin_command() {
  const std::string words = std::exchange(queue_.front(), {});
  queue_.pop_front();
  executor_.event(CncEvent::Kind::kLine, 0, words, ++lines_taken_);
  executing_ = true;
  busy_ns_ = now_ + kBusyNs;
  if (host_command(words)) return;
  const GcodeReading reading = read_gcode(words, executor_.axes().letters);
  if (reading.error) return unknown(words);
  executor_.take(reading.line, lines_taken_);
}

// What is no block of a program. True if it was one.
bool MarlinController::host_command(const std::string& words) {
  if (words == "M400") return draining_ = true;
  if (words == "G28") return executor_.home(), true;
  if (words == "M114") {
    const Axes at = executor_.g54_position();
    std::string report;
    for (int i = 0; i < kAxisCount; ++i) {
      char text[40];
      std::snprintf(text, sizeof text, "%c:%.2f ", executor_.axes().letters[i], at[i]);
      report += text;
    }
    send(report + "E:0.00");
    return true;
  }
  if (words == "M115") {
    send("FIRMWARE_NAME:Marlin 2.1.2 (reforge-rig) AXIS_COUNT:5");
    return true;
  }
  return words.starts_with("M110") || words.starts_with("M73") || words.starts_with("M75");
}

void MarlinController::unknown(const std::string& words) {
  send("echo:Unknown command: \"" + words + "\"");
}

void MarlinController::set_hold_input(bool asserted) {
  const bool edge = asserted && !hold_input_;
  hold_input_ = asserted;
  if (edge && running()) executor_.hold("input");
}

bool MarlinController::running() const {
  return !executor_.held() && !executor_.drained();
}

std::string MarlinController::state_name() const {
  if (killed_) return "Alarm";
  if (executor_.held()) return executor_.at_rest() ? "Hold:0" : "Hold:1";
  return executor_.drained() ? "Idle" : "Run";
}

void MarlinController::press(CncButton button) {
  switch (button) {
    case CncButton::kHold:
    case CncButton::kDoorOpen:
      return executor_.hold("panel");
    case CncButton::kStart:
    case CncButton::kDoorClose:
      executor_.resume();
      return pump();
    case CncButton::kReset:
      executor_.clear();
      return restart();
    case CncButton::kHome:
      if (executor_.drained() && executor_.ready_for_block()) executor_.home();
      return;
  }
}

std::string MarlinController::take_transmitted() {
  return std::exchange(tx_, {});
}

}  // namespace reforge
