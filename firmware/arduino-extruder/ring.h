// Bytes between the main loop and an interrupt: one writer, one reader, neither locks.
// One-byte indices are read and written whole; capacity is a power of two up to 128.
#pragma once

#include <stdint.h>

namespace reforge {
namespace firmware {

template <uint8_t kSize>
class Ring {
  static_assert(kSize <= 128 && (kSize & (kSize - 1)) == 0, "indices wrap with the byte");

 public:
  // False: full, the byte is dropped.
  bool push(uint8_t byte) {
    const uint8_t head = head_;
    if (static_cast<uint8_t>(head - tail_) == kSize) return false;
    bytes_[head & (kSize - 1)] = byte;
    head_ = static_cast<uint8_t>(head + 1);
    return true;
  }
  bool pop(uint8_t& byte) {
    const uint8_t tail = tail_;
    if (tail == head_) return false;
    byte = bytes_[tail & (kSize - 1)];
    tail_ = static_cast<uint8_t>(tail + 1);
    return true;
  }
  bool empty() const { return head_ == tail_; }
  uint8_t room() const { return static_cast<uint8_t>(kSize - static_cast<uint8_t>(head_ - tail_)); }

 private:
  volatile uint8_t bytes_[kSize] = {};
  volatile uint8_t head_ = 0;
  volatile uint8_t tail_ = 0;
};

}  // namespace firmware
}  // namespace reforge
