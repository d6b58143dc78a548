// Constants that stay in the AVR's program memory, and how to read them. On the host they are
// ordinary.
#pragma once

#include <stdint.h>

#ifdef __AVR__
#include <avr/pgmspace.h>
#define REFORGE_FLASH PROGMEM
#else
#define REFORGE_FLASH
#endif

namespace reforge {
namespace firmware {

#ifdef __AVR__
inline uint8_t flash_u8(const void* at) {
  return pgm_read_byte(at);
}
inline int16_t flash_i16(const int16_t* at) {
  return static_cast<int16_t>(pgm_read_word(at));
}
inline int32_t flash_i32(const int32_t* at) {
  return static_cast<int32_t>(pgm_read_dword(at));
}
#else
inline uint8_t flash_u8(const void* at) {
  return *static_cast<const uint8_t*>(at);
}
inline int16_t flash_i16(const int16_t* at) {
  return *at;
}
inline int32_t flash_i32(const int32_t* at) {
  return *at;
}
#endif

}  // namespace firmware
}  // namespace reforge
