// What the extruder board's codes mean, as one sentence each for a person. Host side only.
#pragma once

#include <string_view>

#include "protocols/extruder_wire.h"

namespace reforge {

// A short name for tables and JSON ("extruding"), and a sentence a person can act on. A code this
// version does not know gets a name and a sentence that say so.
std::string_view name_of(wire::State state);
std::string_view sentence_of(wire::State state);

std::string_view name_of(wire::Reason reason);
std::string_view sentence_of(wire::Reason reason);

std::string_view name_of(wire::Fault fault);
std::string_view sentence_of(wire::Fault fault);

std::string_view name_of(wire::Setting setting);

// "power on", "button or port opened", "brown-out", "watchdog": the gravest of the bits.
std::string_view reset_cause_text(uint8_t reset_cause);

}  // namespace reforge
