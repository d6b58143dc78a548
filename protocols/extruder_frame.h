// Frames of the extruder link: sync, length, sequence, type, payload, CRC. Part of extruder_wire.h,
// which says what the frames mean; like it, compiles with avr-g++ as C++14 and on the host.
//
// Bytes: FORMATS.md, "Extruder link". 8N1. Integers in payloads are little-endian.
#pragma once

#include <stdint.h>

namespace reforge {
namespace wire {

constexpr uint32_t kBaud = 115200;
constexpr uint8_t kSync = 0xA5;
constexpr uint8_t kPayloadMax = 32;
constexpr uint8_t kOverhead = 6;  // sync, length, sequence, type, two of CRC
constexpr uint8_t kFrameMax = kPayloadMax + kOverhead;

enum class Type : uint8_t {
  // Host to board.
  kHello = 0x01,         // Hello -> kBanner
  kHeartbeat = 0x02,     // nothing -> kBeat
  kStatusQuery = 0x03,   // nothing -> kStatus
  kGetSetting = 0x04,    // GetSetting -> kSettingValue, or kAck with kUnknownSetting
  kCommand = 0x10,       // Command -> kAck, kDone
  kClearFault = 0x11,    // nothing -> kAck, kDone
  kSetSetting = 0x12,    // SetSetting -> kAck, kDone
  kSaveSettings = 0x13,  // nothing -> kAck, kDone once the EEPROM holds all settings
  // Board to host.
  kBanner = 0x81,
  kBeat = 0x82,
  kStatus = 0x83,
  kSettingValue = 0x84,
  kAck = 0x90,
  kDone = 0x91,
  kFault = 0x92,  // unsolicited, once when a fault latches; sequence 0
};

// CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, not reflected.
constexpr uint16_t kCrcStart = 0xFFFF;
constexpr uint16_t crc_step(uint16_t crc, uint8_t byte) {
  // Four shifts and xors do the work of eight conditional steps (polynomial 0x1021 only).
  uint8_t x = static_cast<uint8_t>((crc >> 8) ^ byte);
  x = static_cast<uint8_t>(x ^ (x >> 4));
  return static_cast<uint16_t>((crc << 8) ^ (static_cast<uint16_t>(x) << 12) ^
                               (static_cast<uint16_t>(x) << 5) ^ x);
}

struct Frame {
  uint8_t length = 0;  // of the payload
  uint8_t sequence = 0;
  Type type = Type::kHello;
  uint8_t payload[kPayloadMax] = {};
};

// Writes the frame's bytes to `out` (room for kFrameMax); returns how many.
constexpr uint8_t encode(const Frame& frame, uint8_t* out) {
  uint8_t n = 0;
  out[n++] = kSync;
  out[n++] = frame.length;
  out[n++] = frame.sequence;
  out[n++] = static_cast<uint8_t>(frame.type);
  for (uint8_t i = 0; i < frame.length; ++i) out[n++] = frame.payload[i];
  uint16_t crc = kCrcStart;
  for (uint8_t i = 1; i < n; ++i) crc = crc_step(crc, out[i]);
  out[n++] = static_cast<uint8_t>(crc >> 8);  // the CRC alone goes high byte first
  out[n++] = static_cast<uint8_t>(crc);
  return n;
}

// Bytes in, frames out. After every push call take() until it returns false. When a frame does not
// check, only its sync byte is dropped and what follows is searched again, so a damaged frame costs
// no whole one.
class Decoder {
 public:
  // False: the byte stands outside any frame (text mode may want it) and was not kept.
  constexpr bool push(uint8_t byte) {
    if (count_ == 0 && byte != kSync) return false;
    bytes_[count_++] = byte;  // fits: take() leaves fewer than a whole frame
    return true;
  }

  constexpr bool take(Frame& frame) {
    while (count_ >= 2) {
      const uint8_t length = bytes_[1];
      if (length > kPayloadMax) {
        reject();
        continue;
      }
      const uint8_t whole = static_cast<uint8_t>(length + kOverhead);
      if (count_ < whole) return false;
      uint16_t crc = kCrcStart;
      for (uint8_t i = 1; i < whole - 2; ++i) crc = crc_step(crc, bytes_[i]);
      if (bytes_[whole - 2] != static_cast<uint8_t>(crc >> 8) ||
          bytes_[whole - 1] != static_cast<uint8_t>(crc)) {
        reject();
        continue;
      }
      frame.length = length;
      frame.sequence = bytes_[2];
      frame.type = static_cast<Type>(bytes_[3]);
      for (uint8_t i = 0; i < length; ++i) frame.payload[i] = bytes_[4 + i];
      drop(whole);
      return true;
    }
    return false;
  }

  // The sender writes a frame without a pause: after 20 ms without a byte the frame begun will not
  // come to its end. Then call take() again.
  constexpr void gap() {
    if (count_ > 0) reject();
  }

  constexpr bool in_frame() const { return count_ > 0; }
  constexpr uint16_t rejected() const { return rejected_; }  // false starts so far, wraps

 private:
  constexpr void reject() {
    ++rejected_;
    drop(1);
  }

  // Removes n bytes and whatever stands before the next sync.
  constexpr void drop(uint8_t n) {
    while (n < count_ && bytes_[n] != kSync) ++n;
    for (uint8_t i = n; i < count_; ++i) bytes_[i - n] = bytes_[i];
    count_ = static_cast<uint8_t>(count_ - n);
  }

  uint8_t bytes_[kFrameMax] = {};
  uint8_t count_ = 0;
  uint16_t rejected_ = 0;
};

class Packer {
 public:
  constexpr Packer(Type type, uint8_t sequence) {
    frame_.type = type;
    frame_.sequence = sequence;
  }
  constexpr Packer& u8(uint8_t v) {
    frame_.payload[frame_.length++] = v;
    return *this;
  }
  constexpr Packer& u16(uint16_t v) {
    return u8(static_cast<uint8_t>(v)).u8(static_cast<uint8_t>(v >> 8));
  }
  constexpr Packer& u32(uint32_t v) {
    return u16(static_cast<uint16_t>(v)).u16(static_cast<uint16_t>(v >> 16));
  }
  constexpr Packer& i16(int16_t v) { return u16(static_cast<uint16_t>(v)); }
  constexpr Packer& i32(int32_t v) { return u32(static_cast<uint32_t>(v)); }
  constexpr const Frame& frame() const { return frame_; }

 private:
  Frame frame_;
};

class Unpacker {
 public:
  explicit constexpr Unpacker(const Frame& frame) : frame_(frame) {}
  constexpr uint8_t u8() { return frame_.payload[at_++]; }
  constexpr uint16_t u16() {
    const uint8_t low = u8();
    return static_cast<uint16_t>(low | (u8() << 8));
  }
  constexpr uint32_t u32() {
    const uint16_t low = u16();
    return low | (static_cast<uint32_t>(u16()) << 16);
  }
  constexpr int16_t i16() { return static_cast<int16_t>(u16()); }
  constexpr int32_t i32() { return static_cast<int32_t>(u32()); }

 private:
  const Frame& frame_;
  uint8_t at_ = 0;
};

constexpr bool is(const Frame& frame, Type type, uint8_t length) {
  return frame.type == type && frame.length == length;
}

}  // namespace wire
}  // namespace reforge
