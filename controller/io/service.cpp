#include "controller/io/service.h"

#include <systemd/sd-daemon.h>

namespace reforge::service {

void ready(const std::string& status) {
  sd_notify(0, ("READY=1\nSTATUS=" + status).c_str());
}

void status(const std::string& sentence) {
  sd_notify(0, ("STATUS=" + sentence).c_str());
}

void stopping() {
  sd_notify(0, "STOPPING=1");
}

void alive() {
  sd_notify(0, "WATCHDOG=1");
}

std::optional<std::chrono::microseconds> watchdog_period() {
  uint64_t allowed_us = 0;
  if (sd_watchdog_enabled(0, &allowed_us) <= 0) return std::nullopt;
  return std::chrono::microseconds(allowed_us / 2);
}

}  // namespace reforge::service
