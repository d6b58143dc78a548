// From converter code to temperature for a 100 kohm NTC under a 4.7 kohm pull-up.
//
// Codes are sums of 16 ten-bit readings (0..16368), temperatures 0.1 C. The table is computed by
// the compiler from Steinhart-Hart through three points of the data sheet (Semitec 104GT-2) and
// lies in flash; between its nodes the temperature is linear in the code (error below 0.5 C from 30
// to 300 C, 1.5 C from 10 to 30).
#pragma once

#include <stdint.h>

namespace reforge {
namespace firmware {

constexpr uint16_t kCodeMax = 16 * 1023;
constexpr uint16_t kCodeOpen = kCodeMax / 100 * 99;  // above: the sensor is open (below -5 C)
constexpr uint16_t kCodeShort = 120;                 // below: shorted (above 350 C)

int16_t temperature_of(uint16_t code);  // kCodeShort <= code <= kCodeOpen

}  // namespace firmware
}  // namespace reforge
