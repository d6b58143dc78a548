// Arbitrary bytes as a program, in every dialect: the reader answers or refuses, and never crashes.
#include <cstdint>
#include <sstream>
#include <string>

#include "protocols/gcode/modal.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace reforge;
  const std::string text(reinterpret_cast<const char*>(data), size);
  for (const CncDialect family : {CncDialect::kGrbl, CncDialect::kMarlin, CncDialect::kFanuc}) {
    std::istringstream in(text);
    gcode::LineReader reader(in, gcode::dialect_of(family, 80, RotaryTable::kBC));
    gcode::Line line;
    gcode::ModalState state;
    for (;;) {
      const Result<bool> read = reader.next(line);
      if (!read) continue;  // go on behind the fault: more of the reader is seen
      if (!*read) break;
      (void)gcode::compact(line);
      const Result<gcode::Action> action = gcode::apply(line, reader.dialect(), state);
      (void)action.ok();
    }
  }
  return 0;
}
