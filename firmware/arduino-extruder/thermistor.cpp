#include "firmware/arduino-extruder/thermistor.h"

#include "firmware/arduino-extruder/flash.h"

namespace reforge {
namespace firmware {
namespace {

// Everything down to kTable runs in the compiler.
constexpr double kPullUpOhm = 4700;
constexpr double kZeroCelsius = 273.15;

// ln x = 2 (y + y^3/3 + y^5/5 + ...), y = (x - 1) / (x + 1), after halving x into [2/3, 4/3].
constexpr double natural_log(double x) {
  double sum = 0;
  while (x > 4.0 / 3) {
    x /= 2;
    sum += 0.6931471805599453;
  }
  while (x < 2.0 / 3) {
    x *= 2;
    sum -= 0.6931471805599453;
  }
  const double y = (x - 1) / (x + 1);
  double power = y;
  for (int n = 1; n < 30; n += 2) {
    sum += 2 * power / n;
    power *= y * y;
  }
  return sum;
}

// 1/T = a + b ln R + c (ln R)^3 through (20 C, 126.8k), (150 C, 1360), (300 C, 80.65).
struct SteinhartHart {
  double a, b, c;
};
constexpr SteinhartHart coefficients() {
  const double l1 = natural_log(126800), l2 = natural_log(1360), l3 = natural_log(80.65);
  const double y1 = 1 / (20 + kZeroCelsius), y2 = 1 / (150 + kZeroCelsius),
               y3 = 1 / (300 + kZeroCelsius);
  const double g2 = (y2 - y1) / (l2 - l1), g3 = (y3 - y1) / (l3 - l1);
  const double c = (g3 - g2) / (l3 - l2) / (l1 + l2 + l3);
  const double b = g2 - c * (l1 * l1 + l1 * l2 + l2 * l2);
  return {y1 - (b + l1 * l1 * c) * l1, b, c};
}

// Hot temperatures crowd at small codes: nodes every 32 below 2048, every 256 above.
constexpr uint16_t kFine = 32, kFineEnd = 2048, kCoarse = 256;
constexpr uint8_t kFineNodes = kFineEnd / kFine;
constexpr uint8_t kNodes = kFineNodes + (16384 - kFineEnd) / kCoarse + 1;

constexpr uint16_t node_code(uint8_t node) {
  return static_cast<uint16_t>(node < kFineNodes ? node * kFine
                                                 : kFineEnd + (node - kFineNodes) * kCoarse);
}

struct Table {
  int16_t tenths[kNodes];
};

constexpr Table make_table() {
  Table table = {};
  const SteinhartHart k = coefficients();
  for (uint8_t node = 0; node < kNodes; ++node) {
    double code = node_code(node);
    if (code < 32) code = 32;                        // below kCodeShort: never looked up
    if (code > kCodeMax - 64) code = kCodeMax - 64;  // the far end of the last interval
    const double l = natural_log(kPullUpOhm * code / (kCodeMax - code));
    const double celsius = 1 / (k.a + k.b * l + k.c * l * l * l) - kZeroCelsius;
    table.tenths[node] = static_cast<int16_t>(celsius * 10 + (celsius < 0 ? -0.5 : 0.5));
  }
  return table;
}

constexpr Table kTable REFORGE_FLASH = make_table();

}  // namespace

int16_t temperature_of(uint16_t code) {
  const uint16_t width = code < kFineEnd ? kFine : kCoarse;
  const uint8_t node = static_cast<uint8_t>(
      code < kFineEnd ? code / kFine : kFineNodes + (code - kFineEnd) / kCoarse);
  const int16_t low = flash_i16(&kTable.tenths[node]);
  const int16_t high = flash_i16(&kTable.tenths[node + 1]);
  const int32_t into = code - node_code(node);
  return static_cast<int16_t>(low + (high - low) * into / width);
}

}  // namespace firmware
}  // namespace reforge
