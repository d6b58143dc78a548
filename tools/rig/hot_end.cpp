#include "tools/rig/hot_end.h"

#include <array>
#include <cassert>
#include <cmath>

namespace reforge {
namespace {

constexpr double kPullUpOhm = 4700;
constexpr double kZeroCelsius = 273.15;

struct SteinhartHart {
  double a, b, c;  // 1/T = a + b ln R + c (ln R)^3
};

// Through (20 C, 126.8k), (150 C, 1360), (300 C, 80.65).
SteinhartHart coefficients() {
  const std::array<double, 3> l = {std::log(126800.0), std::log(1360.0), std::log(80.65)};
  const std::array<double, 3> y = {1 / (20 + kZeroCelsius), 1 / (150 + kZeroCelsius),
                                   1 / (300 + kZeroCelsius)};
  const double g2 = (y[1] - y[0]) / (l[1] - l[0]);
  const double g3 = (y[2] - y[0]) / (l[2] - l[0]);
  const double c = (g3 - g2) / (l[2] - l[1]) / (l[0] + l[1] + l[2]);
  const double b = g2 - c * (l[0] * l[0] + l[0] * l[1] + l[1] * l[1]);
  return {y[0] - (b + l[0] * l[0] * c) * l[0], b, c};
}

// The one real root of c x^3 + b x + (a - 1/T) = 0 (c > 0, b > 0), x = ln R.
double resistance_ohm(double celsius) {
  static const SteinhartHart k = coefficients();
  const double p = k.b / k.c / 3;
  const double q = (k.a - 1 / (celsius + kZeroCelsius)) / k.c / 2;
  const double root = std::sqrt(q * q + p * p * p);
  return std::exp(std::cbrt(root - q) - std::cbrt(root + q));
}

}  // namespace

HotEnd::HotEnd(const HotEndProperties& properties)
    : properties_(properties), block_c_(properties.ambient_c), sensor_c_(properties.ambient_c) {}

void HotEnd::advance(double seconds, bool heater_on) {
  assert(seconds >= 0);
  const double power = heater_on ? properties_.heater_w : 0;
  const double rate = properties_.loss_w_per_k / properties_.heat_capacity_j_per_k;
  const double end_c = properties_.ambient_c + power / properties_.loss_w_per_k;
  const double start_c = block_c_;
  const double block_decay = std::exp(-rate * seconds);
  block_c_ = end_c + (start_c - end_c) * block_decay;

  const double lag = properties_.sensor_lag_s;
  const double sensor_decay = std::exp(-seconds / lag);
  if (wiring_ == SensorWiring::kFallenOut) {
    sensor_c_ = properties_.ambient_c + (sensor_c_ - properties_.ambient_c) * sensor_decay;
    return;
  }
  // The block's exponential seen through the sensor's own; rate * lag == 1 does not occur (minutes
  // against seconds).
  const double through = (start_c - end_c) / (1 - rate * lag);
  sensor_c_ = end_c + through * block_decay + (sensor_c_ - end_c - through) * sensor_decay;
}

double HotEnd::sensor_mv(double supply_mv) const {
  if (wiring_ == SensorWiring::kOpen) return supply_mv;
  if (wiring_ == SensorWiring::kShort) return 0;
  const double ohm = resistance_ohm(sensor_c_);
  return supply_mv * ohm / (ohm + kPullUpOhm);
}

void HotEnd::set_temperature(double celsius) {
  block_c_ = celsius;
  sensor_c_ = celsius;
}

}  // namespace reforge
