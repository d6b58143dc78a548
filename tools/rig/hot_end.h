// A hot end as physics: a block with heat capacity and losses, a heater cartridge, and a thermistor
// that lags behind. Seconds, watts, degrees Celsius, ohms.
//
// Two first-order stages, solved exactly between changes of the heater: block C dT/dt = P - G (T -
// Ta), sensor tau ds/dt = T - s. Limits: one lumped block, no melting enthalpy, no fan. Thermistor:
// 100 kohm NTC by Steinhart-Hart through three points of its data sheet (Semitec 104GT-2), under
// a 4.7 kohm pull-up. Independent of the firmware's table on purpose: it judges it.
#pragma once

namespace reforge {

struct HotEndProperties {
  double heater_w = 40;
  double heat_capacity_j_per_k = 11;
  double loss_w_per_k = 0.075;
  double ambient_c = 22;
  double sensor_lag_s = 1.5;
};

enum class SensorWiring { kConnected, kOpen, kShort, kFallenOut };  // fallen out: it sees the air

class HotEnd {
 public:
  explicit HotEnd(const HotEndProperties& properties = {});

  // Moves on by `seconds` with the heater on or off all the time.
  void advance(double seconds, bool heater_on);

  double block_c() const { return block_c_; }
  double sensor_c() const { return sensor_c_; }
  // What the ADC pin sees of `supply_mv`.
  double sensor_mv(double supply_mv) const;

  void set_temperature(double celsius);  // block and sensor at once
  void set_sensor(SensorWiring wiring) { wiring_ = wiring; }
  void set_heater_power(double watts) { properties_.heater_w = watts; }  // 0: burnt out
  void set_loss(double w_per_k) { properties_.loss_w_per_k = w_per_k; }  // a fan, a lost sock

 private:
  HotEndProperties properties_;
  SensorWiring wiring_ = SensorWiring::kConnected;
  double block_c_;
  double sensor_c_;
};

}  // namespace reforge
