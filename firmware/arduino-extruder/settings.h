// The values of wire::Setting, always inside their bounds (limits.h).
#pragma once

#include <stdint.h>

#include "protocols/extruder_wire.h"

namespace reforge {
namespace firmware {

class Settings {
 public:
  Settings() { restore(); }
  void restore();  // the presets

  int32_t get(wire::Setting id) const { return values_[static_cast<uint8_t>(id)]; }
  // kNone, kUnknownSetting or kBadArgument; refused values change nothing.
  wire::Reason set(wire::Setting id, int32_t value);
  // CRC over all values, 4 little-endian bytes each, in the order of their ids.
  uint16_t hash() const;

  // Microsteps/s times 256 of a filament speed in um/s (at most 100,000), and microsteps of a
  // length in um (at most 200,000), rounded.
  uint32_t rate_q8(int32_t um_per_s) const;
  int32_t steps(int32_t um) const;

 private:
  uint32_t millisteps(int32_t um) const;
  void split_steps_per_metre();

  int32_t values_[wire::kSettingCount];
  // kStepsPerMetre as steps per mm and its thousandths: a 32-bit division costs the AVR 40 us.
  uint16_t steps_per_mm_;
  uint16_t millisteps_per_mm_;
};

}  // namespace firmware
}  // namespace reforge
