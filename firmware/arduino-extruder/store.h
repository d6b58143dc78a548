// Settings in EEPROM: two copies, each with a generation and a CRC; the newer whole one counts.
//
// Saving writes the older copy byte by byte, one a call, so that no duty waits for the 3.3 ms of a
// write, and its CRC last: whenever the supply fails, one whole copy is left. Copy k begins at k *
// kCopySize: generation u8, count u8, values i32 little-endian each, CRC high byte first.
#pragma once

#include <stdint.h>

#include "firmware/arduino-extruder/settings.h"

namespace reforge {
namespace firmware {

// The memory as the store sees it.
struct Eeprom {
  uint8_t (*read)(uint16_t address);
  bool (*ready)();  // the last write has come to its end
  void (*write)(uint16_t address, uint8_t value);
};

constexpr uint16_t kCopySize = 128;

class Store {
 public:
  explicit Store(const Eeprom& eeprom) : eeprom_(eeprom) {}

  // The newer whole copy's values; values outside today's bounds stay at their presets. Without a
  // whole copy all settings are presets.
  void load(Settings& settings);

  void begin_save(const Settings& settings);
  enum class Progress : uint8_t { kIdle, kWriting, kSaved, kFailed };
  Progress advance();  // at most one byte written a call; kSaved or kFailed once

 private:
  bool whole(uint8_t copy) const;
  uint8_t image(uint8_t at) const;

  Eeprom eeprom_;
  const Settings* saving_ = nullptr;
  uint8_t copy_ = 0;        // of the newest whole one, or the one being written
  uint8_t generation_ = 0;  // likewise
  uint8_t at_ = 0;
  uint16_t crc_ = 0;
};

}  // namespace firmware
}  // namespace reforge
