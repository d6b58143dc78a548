// What the extruder board's settings and the rig file must agree on before a job.
//
// Facts of the wiring are only compared; the others are written to the board (not saved) when they
// differ. What every order carries as its argument needs no agreement.
#pragma once

#include <optional>
#include <span>

#include "protocols/extruder_wire.h"
#include "protocols/rig.h"

namespace reforge {

struct Agreement {
  wire::Setting id;
  bool writable;
};

std::span<const Agreement> agreements();

// The rig file's value in the board's unit; none when the board's is taken as it is.
std::optional<std::int32_t> wanted_value(wire::Setting id, const RigDescription& rig);

}  // namespace reforge
