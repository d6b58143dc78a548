#include "tools/rig/avr_extruder.h"

namespace reforge {

void AvrExtruder::receive(std::string_view bytes) {
  board_->receive({reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size()});
}

std::string AvrExtruder::take_transmitted() {
  const std::vector<uint8_t> bytes = board_->take_transmitted();
  return {bytes.begin(), bytes.end()};
}

std::vector<FilamentStep> AvrExtruder::take_steps() {
  std::vector<FilamentStep> steps;
  for (const StepEdge& edge : board_->take_steps()) steps.push_back({edge.ns, edge.direction});
  return steps;
}

}  // namespace reforge
