// What the simulated CNC says of itself: `$` commands and status reports.
#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>

#include "tools/rig/grbl_controller.h"

namespace reforge {
namespace {

constexpr int64_t kEepromNs = 20'000'000;
constexpr int kOffsetsEveryIdle = 10;  // status reports
constexpr int kOffsetsEveryBusy = 30;
constexpr int kOverridesEvery = 20;

std::string fixed3(double value) {
  std::array<char, 48> text{};
  const int n = std::snprintf(text.data(), text.size(), "%.3f", value);
  std::string out(text.data(), static_cast<size_t>(n));
  return out == "-0.000" ? "0.000" : out;
}

bool is_whole_setting(int id) {
  return (id < 24 && id != 11 && id != 12) || id == 26 || (id >= 30 && id <= 32);
}

// Those this simulation honours; the others are reported as they are and cannot be written.
bool is_writable_setting(int id) {
  return id == 11 || id == 20 || (id >= 110 && id < 110 + kAxisCount) ||
         (id >= 120 && id < 120 + kAxisCount);
}

}  // namespace

std::map<int, double> GrblController::default_settings(const RigDescription& rig,
                                                       const CncAxes& axes) {
  std::map<int, double> settings{{0, 10},
                                 {1, 25},
                                 {2, 0},
                                 {3, 0},
                                 {4, 0},
                                 {5, 0},
                                 {6, 0},
                                 {10, 511},
                                 {11, 0.01},
                                 {12, 0.002},
                                 {13, 0},
                                 {20, 1},
                                 {21, 0},
                                 {22, 1},
                                 {23, 0},
                                 {24, 100},
                                 {25, 1000},
                                 {26, 250},
                                 {27, 1},
                                 {30, rig.spindle.max_rpm},
                                 {31, rig.spindle.min_rpm},
                                 {32, 0}};
  for (int i = 0; i < kAxisCount; ++i) {
    settings[100 + i] = 400;
    settings[110 + i] = axes.rate[i] * 60;
    settings[120 + i] = axes.acceleration[i];
    settings[130 + i] = axes.max[i] - axes.min[i];
  }
  return settings;
}

void GrblController::send(const std::string& line) {
  tx_ += line + "\r\n";
}

void GrblController::send_banner() {
  tx_ += "\r\nGrblHAL 1.1f ['$' or '$HELP' for help]\r\n";
  if (in_alarm()) send("[MSG:'$H'|'$X' to unlock]");
}

std::string GrblController::numbers(const Axes& values) const {
  std::string text;
  for (const double value : values) text += (text.empty() ? "" : ",") + fixed3(value);
  return text;
}

std::string GrblController::state_name() const {
  if (in_alarm()) return "Alarm";
  if (stage_ == Stage::kHome) return "Home";
  if (hold_ && door_) {
    if (!motion_.at_rest()) return "Door:2";
    return door_open_ ? "Door:1" : "Door:0";
  }
  if (hold_) return motion_.at_rest() ? "Hold:0" : "Hold:1";
  return motion_.empty() ? "Idle" : "Run";
}

void GrblController::report_status() {
  const std::string state = state_name();
  std::string report = "<" + state + "|MPos:" + numbers(motion_.position());
  report += "|Bf:" + std::to_string(motion_.free_blocks()) + "," +
            std::to_string(receive_buffer_bytes_ - static_cast<int>(rx_.size()));
  if (motion_.front_line() > 0) report += "|Ln:" + std::to_string(motion_.front_line());
  report += "|FS:" + std::to_string(std::lround(motion_.speed() * 60)) + "," +
            std::to_string(std::lround(std::abs(spindle_rpm())));
  if (hold_input_ || door_open_) {
    report += std::string("|Pn:") + (door_open_ ? "D" : "") + (hold_input_ ? "H" : "");
  }
  if (reports_to_offsets_ == 0) {
    report += "|WCO:" + numbers(offsets_[modal_.coordinate_system]);
    reports_to_offsets_ = state == "Run" || state == "Home" ? kOffsetsEveryBusy : kOffsetsEveryIdle;
    if (reports_to_overrides_ <= 0) reports_to_overrides_ = 1;  // never both in one report
  } else if (reports_to_overrides_ <= 0) {
    report += "|Ov:" + std::to_string(feed_percent_) + "," + std::to_string(rapid_percent_) + "," +
              std::to_string(spindle_percent_);
    reports_to_overrides_ = kOverridesEvery;
  }
  --reports_to_offsets_;
  --reports_to_overrides_;
  send(report + ">");
}

// Returns GRBL's error number, or leaves the stage changed when the answer comes later.
int GrblController::system_command(std::string_view command) {
  if (command == "$") {
    send("[HLP:$$ $# $G $I $x=val $X $H ~ ! ? ctrl-x]");
    return 0;
  }
  if (command == "$G") return report_modes(), 0;
  if (command == "$X") {
    if (in_alarm()) {
      alarm_ = 0;
      send("[MSG:Caution: Unlocked]");
    }
    return 0;
  }
  if (!motion_.empty()) return grbl_error::kNotIdle;
  if (command == "$$") return report_settings(), 0;
  if (command == "$#") return report_offsets(), 0;
  if (command == "$I") return report_build(), 0;
  if (command == "$H") {
    stage_ = Stage::kHome;
    home_phase_ = 0;
    alarm_ = 0;
    return 0;
  }
  return write_setting(command);
}

int GrblController::write_setting(std::string_view command) {
  const size_t equals = command.find('=');
  if (equals == std::string_view::npos) return grbl_error::kInvalidStatement;
  int id = -1;
  double value = 0;
  const auto id_end = std::from_chars(command.data() + 1, command.data() + equals, id);
  const auto value_end =
      std::from_chars(command.data() + equals + 1, command.data() + command.size(), value);
  if (id_end.ec != std::errc{} || id_end.ptr != command.data() + equals) {
    return grbl_error::kInvalidStatement;
  }
  if (value_end.ec != std::errc{} || value_end.ptr != command.data() + command.size()) {
    return grbl_error::kBadNumber;
  }
  if (!settings_.contains(id) || !is_writable_setting(id)) return grbl_error::kInvalidStatement;
  if (value < 0 || (id >= 110 && value == 0)) return grbl_error::kNegative;
  settings_[id] = value;
  motion_.set_limits(motion_limits());
  stage_ = Stage::kStall;
  ready_ns_ = now_ + kEepromNs;
  return 0;
}

void GrblController::report_settings() {
  for (const auto& [id, value] : settings_) {
    send("$" + std::to_string(id) + "=" +
         (is_whole_setting(id) ? std::to_string(std::lround(value)) : fixed3(value)));
  }
}

void GrblController::report_offsets() {
  for (int i = 0; i < 6; ++i)
    send("[G" + std::to_string(54 + i) + ":" + numbers(offsets_[i]) + "]");
  for (const char* other : {"G28", "G30", "G92"}) {
    send("[" + std::string(other) + ":" + numbers({}) + "]");
  }
  send("[TLO:0.000]");
  send("[PRB:" + numbers({}) + ":0]");
}

void GrblController::report_modes() {
  const std::string units = modal_.inches ? "G20" : "G21";
  send("[GC:G" + std::to_string(modal_.motion) + " G" +
       std::to_string(54 + modal_.coordinate_system) + " G17 " + units +
       (modal_.incremental ? " G91" : " G90") + " G94 M" + std::to_string(modal_.spindle) +
       (modal_.coolant ? " M8" : " M9") + " T" + std::to_string(modal_.tool) + " F" +
       std::to_string(std::lround(modal_.feed_per_min)) + " S" +
       std::to_string(std::lround(modal_.rpm)) + "]");
}

void GrblController::report_build() {
  send("[VER:1.1f.20240101:reforge-rig]");
  send("[OPT:VNL," + std::to_string(MotionQueue::kCapacity) + "," +
       std::to_string(receive_buffer_bytes_) + "," + std::to_string(kAxisCount) + ",0]");
  send("[AXS:" + std::to_string(kAxisCount) + ":" + axes_.letters + "]");
  send("[FIRMWARE:grblHAL]");
}

}  // namespace reforge
