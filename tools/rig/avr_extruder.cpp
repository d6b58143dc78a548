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

void AvrExtruder::set_cnc_outputs(const CncOutputs& outputs) {
  if (outputs == wired_) return;
  wired_ = outputs;
  board_->set_signal(CncSignal::kOpenModule, outputs.open);
  board_->set_signal(CncSignal::kExtrude, outputs.extrude);
  board_->set_signal(CncSignal::kRetract, outputs.retract);
  board_->set_signal(CncSignal::kRunning, outputs.running);
}

void AvrExtruder::suffer(BoardMishap mishap) {
  switch (mishap) {
    case BoardMishap::kReset:
      return board_->reset(BoardReset::kButton);
    case BoardMishap::kBrownOut:
      return board_->reset(BoardReset::kBrownOut);
    case BoardMishap::kPowerCycle:
      return board_->reset(BoardReset::kPowerOn);
    case BoardMishap::kHang:
      return board_->hang();
    case BoardMishap::kSensorConnected:
      return board_->hot_end().set_sensor(SensorWiring::kConnected);
    case BoardMishap::kSensorOpen:
      return board_->hot_end().set_sensor(SensorWiring::kOpen);
    case BoardMishap::kSensorShort:
      return board_->hot_end().set_sensor(SensorWiring::kShort);
    case BoardMishap::kSensorFallenOut:
      return board_->hot_end().set_sensor(SensorWiring::kFallenOut);
    case BoardMishap::kHeaterBroken:
      return board_->hot_end().set_heater_power(0);
    case BoardMishap::kFilamentOut:
      return board_->set_filament_present(false);
    case BoardMishap::kFilamentIn:
      return board_->set_filament_present(true);
  }
}

}  // namespace reforge
