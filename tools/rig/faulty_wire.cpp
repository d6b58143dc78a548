#include "tools/rig/faulty_wire.h"

#include <algorithm>

namespace reforge {

bool FaultyWire::chance(double probability) {
  if (probability <= 0) return false;
  return static_cast<double>(random_() >> 11) * 0x1p-53 < probability;
}

void FaultyWire::send(std::string_view bytes, int64_t now_ns) {
  int64_t due = now_ns + latency_ns_;
  if (noise_.delay_ns > 0) {
    due += static_cast<int64_t>(random_() % static_cast<uint64_t>(noise_.delay_ns + 1));
  }
  due = std::max(due, last_due_ns_);
  last_due_ns_ = due;
  for (char byte : bytes) {
    if (drop_ > 0 || chance(noise_.drop)) {
      drop_ = std::max(0, drop_ - 1);
      ++faults_;
      continue;
    }
    if (flip_ > 0 || chance(noise_.flip)) {
      flip_ = std::max(0, flip_ - 1);
      byte = static_cast<char>(byte ^ (1 << random_() % 8));
      ++faults_;
    }
    inside_.push_back({due, byte});
    if (duplicate_ > 0 || chance(noise_.duplicate)) {
      duplicate_ = std::max(0, duplicate_ - 1);
      inside_.push_back({due, byte});
      ++faults_;
    }
  }
}

std::string FaultyWire::take(int64_t now_ns) {
  std::string out;
  if (now_ns < stalled_ns_) return out;
  while (!inside_.empty() && inside_.front().due_ns <= now_ns) {
    out += inside_.front().value;
    inside_.pop_front();
  }
  return out;
}

}  // namespace reforge
