#include "protocols/gcode/dialect.h"

#include <cassert>

namespace reforge::gcode {

Dialect dialect_of(CncDialect family, std::size_t line_length_max, RotaryTable table) {
  const std::string_view axes = table == RotaryTable::kBC ? "XYZBC" : "XYZAC";
  switch (family) {
    case CncDialect::kGrbl:
      return {"grbl", line_length_max, true, true, true, false, true, 1.0, axes};
    case CncDialect::kMarlin:
      return {"marlin", line_length_max, true, true, false, false, true, 0.001, axes};
    case CncDialect::kFanuc:
      return {"fanuc", line_length_max, false, true, true, true, true, 0.001, axes};
  }
  assert(false);
  return {};
}

Dialect dialect_of(const CncLink& link, RotaryTable table) {
  assert(link.line_length_max > 0);
  return dialect_of(link.dialect, static_cast<std::size_t>(link.line_length_max), table);
}

}  // namespace reforge::gcode
