#include "firmware/arduino-extruder/store.h"

namespace reforge {
namespace firmware {
namespace {

constexpr uint8_t kBody = 2 + 4 * wire::kSettingCount;
constexpr uint8_t kImage = kBody + 2;
static_assert(kImage <= kCopySize, "a copy fits");

}  // namespace

bool Store::whole(uint8_t copy) const {
  const uint16_t base = static_cast<uint16_t>(copy * kCopySize);
  if (eeprom_.read(static_cast<uint16_t>(base + 1)) != wire::kSettingCount) return false;
  uint16_t crc = wire::kCrcStart;
  for (uint8_t i = 0; i < kBody; ++i) {
    crc = wire::crc_step(crc, eeprom_.read(static_cast<uint16_t>(base + i)));
  }
  return eeprom_.read(static_cast<uint16_t>(base + kBody)) == static_cast<uint8_t>(crc >> 8) &&
         eeprom_.read(static_cast<uint16_t>(base + kBody + 1)) == static_cast<uint8_t>(crc);
}

void Store::load(Settings& settings) {
  settings.restore();
  const bool first = whole(0);
  const bool second = whole(1);
  if (!first && !second) return;
  const uint8_t generation0 = eeprom_.read(0);
  const uint8_t generation1 = eeprom_.read(kCopySize);
  const bool second_newer = static_cast<int8_t>(generation1 - generation0) > 0;
  copy_ = second && (!first || second_newer) ? 1 : 0;
  generation_ = copy_ == 1 ? generation1 : generation0;
  uint16_t at = static_cast<uint16_t>(copy_ * kCopySize + 2);
  for (uint8_t id = 0; id < wire::kSettingCount; ++id) {
    uint32_t value = 0;
    for (uint8_t byte = 0; byte < 4; ++byte, ++at) {
      value |= static_cast<uint32_t>(eeprom_.read(at)) << (8 * byte);
    }
    settings.set(static_cast<wire::Setting>(id), static_cast<int32_t>(value));
  }
}

void Store::begin_save(const Settings& settings) {
  if (saving_ == nullptr) {  // a save begun anew goes to the same copy: the other is the whole one
    copy_ = copy_ == 0 ? 1 : 0;
    generation_ = static_cast<uint8_t>(generation_ + 1);
  }
  saving_ = &settings;
  at_ = 0;
  crc_ = wire::kCrcStart;
}

uint8_t Store::image(uint8_t at) const {
  if (at == 0) return generation_;
  if (at == 1) return wire::kSettingCount;
  if (at == kBody) return static_cast<uint8_t>(crc_ >> 8);
  if (at == kBody + 1) return static_cast<uint8_t>(crc_);
  const uint8_t offset = static_cast<uint8_t>(at - 2);
  const int32_t value = saving_->get(static_cast<wire::Setting>(offset / 4));
  return static_cast<uint8_t>(static_cast<uint32_t>(value) >> (8 * (offset % 4)));
}

Store::Progress Store::advance() {
  if (saving_ == nullptr) return Progress::kIdle;
  if (!eeprom_.ready()) return Progress::kWriting;
  if (at_ < kImage) {
    const uint8_t byte = image(at_);
    if (at_ < kBody) crc_ = wire::crc_step(crc_, byte);
    eeprom_.write(static_cast<uint16_t>(copy_ * kCopySize + at_), byte);
    ++at_;
    return Progress::kWriting;
  }
  saving_ = nullptr;
  if (whole(copy_)) return Progress::kSaved;
  copy_ = copy_ == 0 ? 1 : 0;  // the other copy is still the newest whole one
  generation_ = static_cast<uint8_t>(generation_ - 1);
  return Progress::kFailed;
}

}  // namespace firmware
}  // namespace reforge
