// An order to the extruder: one M-code with its argument, in the units of programs.
#pragma once

#include <cstdint>
#include <string>

namespace reforge {

// An M-code with its argument: M70 °C, M72 mm of filament a second, M74 mm; others none.
struct ExtruderOrder {
  int m_code;
  double argument = 0;
  friend bool operator==(const ExtruderOrder&, const ExtruderOrder&) = default;
};
std::string to_string(const ExtruderOrder& order);  // "M72 P0.3466"
// The argument as protocols/extruder_wire.h carries it: 0.1 °C, um/s, um.
std::int32_t wire_argument(const ExtruderOrder& order);

}  // namespace reforge
