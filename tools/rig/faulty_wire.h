// The fault proxy: one direction of a link, between the host and the wire, that loses, spoils,
// doubles, delays and holds back bytes: by chance from a seed, or the next ones by order.
//
// Without faults bytes pass at once. Order is always kept. The same seed and calls give the same
// faults. Unplugging a port and exchanging two are the rim's affair (rig_server.h).
#pragma once

#include <cstdint>
#include <deque>
#include <random>
#include <string>
#include <string_view>

#include "tools/rig/virtual_time.h"

namespace reforge {

// Chances per byte, 0..1; delays up to `delay_ns` more for each batch of bytes.
struct WireNoise {
  double drop = 0, flip = 0, duplicate = 0;
  int64_t delay_ns = 0;
};

class FaultyWire {
 public:
  explicit FaultyWire(uint64_t seed) : random_(seed) {}

  void set_noise(const WireNoise& noise) { noise_ = noise; }
  // Of the next bytes sent.
  void drop(int bytes) { drop_ += bytes; }
  void flip(int bytes) { flip_ += bytes; }  // one bit each
  void duplicate(int bytes) { duplicate_ += bytes; }
  void delay(int64_t ns) { latency_ns_ = ns; }              // of all from now on
  void stall(int64_t until_ns) { stalled_ns_ = until_ns; }  // then everything at once

  void send(std::string_view bytes, int64_t now_ns);
  std::string take(int64_t now_ns);
  int64_t faults() const { return faults_; }  // bytes dropped, flipped and duplicated so far

 private:
  struct Byte {
    int64_t due_ns;
    char value;
  };
  bool chance(double probability);

  std::mt19937_64 random_;
  WireNoise noise_;
  int drop_ = 0, flip_ = 0, duplicate_ = 0;
  int64_t latency_ns_ = 0, stalled_ns_ = 0, last_due_ns_ = 0;
  std::deque<Byte> inside_;
  int64_t faults_ = 0;
};

}  // namespace reforge
