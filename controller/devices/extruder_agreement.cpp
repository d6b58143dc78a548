#include "controller/devices/extruder_agreement.h"

#include <cmath>

namespace reforge {

namespace {

constexpr Agreement kAgreements[] = {
    {wire::Setting::kInStream, false},          {wire::Setting::kSilence, false},
    {wire::Setting::kStepsPerMetre, true},      {wire::Setting::kRetractSpeed, true},
    {wire::Setting::kMinimumTemperature, true}, {wire::Setting::kMaximumTemperature, true},
};

std::int32_t thousandths(double value) {
  return static_cast<std::int32_t>(std::lround(value * 1000));
}
std::int32_t tenths(double value) {
  return static_cast<std::int32_t>(std::lround(value * 10));
}

}  // namespace

std::span<const Agreement> agreements() {
  return kAgreements;
}

std::optional<std::int32_t> wanted_value(wire::Setting id, const RigDescription& rig) {
  switch (id) {
    case wire::Setting::kInStream:
      return rig.cnc.m_codes == MCodeRoute::kInStream ? 1 : 0;
    case wire::Setting::kStepsPerMetre:
      return thousandths(rig.extrusion.steps_per_mm);
    case wire::Setting::kRetractSpeed:
      return thousandths(rig.extrusion.retract_mm_per_s);
    case wire::Setting::kMinimumTemperature:
      return tenths(rig.extrusion.minimum_temperature.value());
    case wire::Setting::kMaximumTemperature:
      return tenths(rig.extrusion.maximum_temperature.value());
    default:
      return std::nullopt;
  }
}

}  // namespace reforge
