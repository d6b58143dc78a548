#include "tools/rig/board_memory.h"

#include <cmath>

#include "firmware/arduino-extruder/settings.h"
#include "protocols/extruder_wire.h"

namespace reforge {
namespace {

int32_t rounded(double value) {
  return static_cast<int32_t>(std::lround(value));
}

// The rate of a bead at the programmed feed (RIG.md, "Extrusion without an E axis").
double filament_um_per_s(const Extrusion& e) {
  const double area = std::acos(-1.0) / 4 * e.filament_diameter_mm * e.filament_diameter_mm;
  return 1000 * e.feed_mm_per_s * e.bead_width_mm * e.layer_height_mm / area * e.multiplier;
}

}  // namespace

std::vector<uint8_t> commissioned_memory(const RigDescription& rig) {
  using wire::Setting;
  const Extrusion& e = rig.extrusion;
  firmware::Settings settings;
  settings.restore();
  // What the board would refuse stays its preset; the daemon's comparison finds it.
  const auto set = [&](Setting id, int32_t value) { settings.set(id, value); };
  set(Setting::kInStream, rig.cnc.m_codes == MCodeRoute::kInStream ? 1 : 0);
  set(Setting::kStepsPerMetre, rounded(e.steps_per_mm * 1000));
  set(Setting::kFilamentSpeed, rounded(filament_um_per_s(e)));
  set(Setting::kRetractLength, rounded(e.retract_mm * 1000));
  set(Setting::kRetractSpeed, rounded(e.retract_mm_per_s * 1000));
  set(Setting::kTargetTemperature, rounded(e.nozzle_temperature.value() * 10));
  set(Setting::kMinimumTemperature, rounded(e.minimum_temperature.value() * 10));
  set(Setting::kMaximumTemperature, rounded(e.maximum_temperature.value() * 10));

  std::vector<uint8_t> bytes{1, wire::kSettingCount};  // generation, number of settings
  for (uint8_t id = 0; id < wire::kSettingCount; ++id) {
    const auto value = static_cast<uint32_t>(settings.get(static_cast<Setting>(id)));
    for (int byte = 0; byte < 4; ++byte) bytes.push_back(static_cast<uint8_t>(value >> (8 * byte)));
  }
  uint16_t crc = wire::kCrcStart;
  for (const uint8_t byte : bytes) crc = wire::crc_step(crc, byte);
  bytes.push_back(static_cast<uint8_t>(crc >> 8));
  bytes.push_back(static_cast<uint8_t>(crc));
  return bytes;
}

}  // namespace reforge
