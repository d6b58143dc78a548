// The extruder board's EEPROM as its operator has set it up for a rig: what the rig file says and
// no order carries, above all whether M-codes come by the CNC's outputs. Bytes: FORMATS.md,
// "Settings in EEPROM".
#pragma once

#include <cstdint>
#include <vector>

#include "protocols/rig.h"

namespace reforge {

std::vector<uint8_t> commissioned_memory(const RigDescription& rig);

}  // namespace reforge
