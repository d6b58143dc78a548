// One direction of a serial wire: bytes go one behind the other, ten bits each, and arrive when
// their stop bit has passed. The seam where a proxy may damage the link: it stands between send()
// and what is sent.
#pragma once

#include <deque>
#include <string>
#include <string_view>

#include "tools/rig/virtual_time.h"

namespace reforge {

class UartLine {
 public:
  explicit UartLine(int baud) : ns_per_byte_(10 * kNsPerSecond / baud) {}

  void send(std::string_view bytes, int64_t now_ns);
  int64_t next_arrival_ns() const;  // kNeverNs: nothing on its way
  std::string take_arrived(int64_t now_ns);

 private:
  struct Byte {
    int64_t arrives_ns;
    char value;
  };
  int64_t ns_per_byte_;
  int64_t free_from_ns_ = 0;
  std::deque<Byte> on_its_way_;
};

}  // namespace reforge
