#include "tools/rig/uart_line.h"

#include <algorithm>

namespace reforge {

void UartLine::send(std::string_view bytes, int64_t now_ns) {
  for (const char byte : bytes) {
    free_from_ns_ = std::max(free_from_ns_, now_ns) + ns_per_byte_;
    on_its_way_.push_back({free_from_ns_, byte});
  }
}

int64_t UartLine::next_arrival_ns() const {
  return on_its_way_.empty() ? kNeverNs : on_its_way_.front().arrives_ns;
}

std::string UartLine::take_arrived(int64_t now_ns) {
  std::string bytes;
  while (!on_its_way_.empty() && on_its_way_.front().arrives_ns <= now_ns) {
    bytes += on_its_way_.front().value;
    on_its_way_.pop_front();
  }
  return bytes;
}

}  // namespace reforge
