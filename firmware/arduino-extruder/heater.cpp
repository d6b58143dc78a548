#include "firmware/arduino-extruder/heater.h"

#include "firmware/arduino-extruder/limits.h"
#include "firmware/arduino-extruder/thermistor.h"

namespace reforge {
namespace firmware {
namespace {

using wire::Fault;
using wire::Setting;

constexpr uint8_t kReadingsPerWindow = 64;
constexpr int32_t kWindowMs = 64;
constexpr int32_t kFullPower = 255;
// integral_ * kWindowMs / 1000 is in power times 256.
constexpr int32_t kIntegralMax = kFullPower * 256 / kWindowMs * 1000;

int32_t bounded(int32_t value, int32_t least, int32_t most) {
  return value < least ? least : value > most ? most : value;
}

}  // namespace

void Heater::set_target(int16_t tenths, uint32_t now_ms) {
  target_ = tenths;
  integral_ = 0;
  reached_ = at_target_ = in_band_ = false;
  bad_windows_ = 0;
  rise_from_ = temperature_;
  rise_since_ = now_ms;
  window_ms_ = now_ms;
}

void Heater::off() {
  target_ = 0;
  power_ = 0;
  slot_rest_ = 0;
  reached_ = at_target_ = in_band_ = false;
}

void Heater::sample(uint16_t reading, uint32_t now_ms) {
  sum_ = static_cast<uint16_t>(sum_ + reading);  // 64 * 1023 < 2^16
  if (readings_ == 0) least_ = most_ = reading;
  if (reading < least_) least_ = reading;
  if (reading > most_) most_ = reading;
  if (++readings_ < kReadingsPerWindow) return;
  const uint16_t code = sum_ / 4;
  sum_ = 0;
  readings_ = 0;
  window_ms_ = now_ms;
  if (fitted()) window(code, now_ms);
}

void Heater::window(uint16_t code, uint32_t now_ms) {
  fault_ = Fault::kNone;
  // Readings far apart are a contact coming or going: their mean is no temperature.
  if (code > kCodeOpen || code < kCodeShort || most_ - least_ > kReadingSpread) {
    temperature_ = wire::kTemperatureUnknown;
    power_ = 0;  // at once; the fault waits for a few windows in a row
    if (bad_windows_ < kSensorBadWindows) ++bad_windows_;
    if (bad_windows_ == kSensorBadWindows && heating()) {
      fault_ = code > kCodeMax / 2 ? Fault::kSensorOpen : Fault::kSensorShort;
    }
    return;
  }
  const int16_t before = temperature_;
  temperature_ = temperature_of(code);
  bad_windows_ = 0;
  if (before == wire::kTemperatureUnknown) {
    slope_ = 0;
  } else {
    const int32_t slope = static_cast<int32_t>(temperature_ - before) * 1000 / kWindowMs;
    slope_ = static_cast<int16_t>(slope_ + (slope - slope_) / 8);
  }
  if (temperature_ > settings_.get(Setting::kMaximumTemperature)) {
    fault_ = Fault::kOverTemperature;
  } else if (heating()) {
    regulate();
    watch(now_ms);
  }
}

void Heater::regulate() {
  const int32_t error = target_ - temperature_;
  if (error > kIntegralBand) {
    integral_ = 0;
  } else {
    integral_ = bounded(integral_ + settings_.get(Setting::kPidI) * error, 0, kIntegralMax);
  }
  const int32_t power = settings_.get(Setting::kPidP) * error + integral_ * 8 / 125 -
                        settings_.get(Setting::kPidD) * slope_;
  power_ = static_cast<uint8_t>(bounded(power / 256, 0, kFullPower));
}

void Heater::watch(uint32_t now_ms) {
  const int16_t error = static_cast<int16_t>(target_ - temperature_);

  const bool in_band = error <= kAtTargetBand && error >= -kAtTargetBand;
  if (in_band && !in_band_) in_band_since_ = now_ms;
  in_band_ = in_band;
  if (in_band && now_ms - in_band_since_ >= kAtTargetTime) at_target_ = true;

  const int32_t runaway = settings_.get(Setting::kRunawayTemperature);
  if (error <= runaway) {
    reached_ = true;
    rise_since_ = now_ms;
    rise_from_ = temperature_;
  } else if (reached_) {
    const int32_t time = settings_.get(Setting::kRunawayTime);
    if (now_ms - rise_since_ >= static_cast<uint32_t>(time)) fault_ = Fault::kRunaway;
  } else if (rise_from_ == wire::kTemperatureUnknown ||
             temperature_ - rise_from_ >= settings_.get(Setting::kRiseTemperature)) {
    rise_since_ = now_ms;
    rise_from_ = temperature_;
  } else {
    const int32_t time = settings_.get(Setting::kRiseTime);
    if (now_ms - rise_since_ >= static_cast<uint32_t>(time)) fault_ = Fault::kNoRise;
  }
}

Fault Heater::check(uint32_t now_ms) {
  if (!fitted()) return Fault::kNone;
  if (heating() && now_ms - window_ms_ > kSamplingSilence) return Fault::kInternal;
  return fault_;
}

bool Heater::warm(int16_t margin) const {
  if (!fitted()) return true;  // the rig's own controller answers for it
  if (temperature_ == wire::kTemperatureUnknown) return false;
  return temperature_ >= settings_.get(Setting::kMinimumTemperature) - margin;
}

bool Heater::slot() {
  const uint16_t sum = static_cast<uint16_t>(slot_rest_ + power_ + (power_ == kFullPower ? 1 : 0));
  slot_rest_ = static_cast<uint8_t>(sum);
  return sum > 255;
}

}  // namespace firmware
}  // namespace reforge
