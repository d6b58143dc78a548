#include "firmware/arduino-extruder/settings.h"

#include "firmware/arduino-extruder/limits.h"

namespace reforge {
namespace firmware {

void Settings::restore() {
  for (uint8_t i = 0; i < wire::kSettingCount; ++i)
    values_[i] = flash_i32(&kSettingLimits[i].preset);
  split_steps_per_metre();
}

void Settings::split_steps_per_metre() {
  const int32_t steps_per_metre = get(wire::Setting::kStepsPerMetre);
  steps_per_mm_ = static_cast<uint16_t>(steps_per_metre / 1000);
  millisteps_per_mm_ = static_cast<uint16_t>(steps_per_metre % 1000);
}

wire::Reason Settings::set(wire::Setting id, int32_t value) {
  const uint8_t i = static_cast<uint8_t>(id);
  if (i >= wire::kSettingCount) return wire::Reason::kUnknownSetting;
  if (value < flash_i32(&kSettingLimits[i].least) || value > flash_i32(&kSettingLimits[i].most)) {
    return wire::Reason::kBadArgument;
  }
  values_[i] = value;
  split_steps_per_metre();
  return wire::Reason::kNone;
}

uint16_t Settings::hash() const {
  uint16_t crc = wire::kCrcStart;
  for (const int32_t value : values_) {
    uint32_t rest = static_cast<uint32_t>(value);
    for (uint8_t byte = 0; byte < 4; ++byte, rest >>= 8) {
      crc = wire::crc_step(crc, static_cast<uint8_t>(rest));
    }
  }
  return crc;
}

// Thousandths of a microstep in `um` of filament, cut off. 32 bits are enough within the bounds
// (200 mm, 5,000 steps/mm), and 64-bit arithmetic would cost a twentieth of the flash.
uint32_t Settings::millisteps(int32_t um) const {
  const uint32_t length = static_cast<uint32_t>(um);
  const uint32_t whole = length * steps_per_mm_;
  return millisteps_per_mm_ == 0 ? whole : whole + length * millisteps_per_mm_ / 1000;
}

uint32_t Settings::rate_q8(int32_t um_per_s) const {
  const uint32_t millisteps_per_s = millisteps(um_per_s);
  return millisteps_per_s / 125 * 32 + millisteps_per_s % 125 * 32 / 125;  // * 256 / 1000
}

int32_t Settings::steps(int32_t um) const {
  return static_cast<int32_t>((millisteps(um) + 500) / 1000);
}

}  // namespace firmware
}  // namespace reforge
