// The daemon as a systemd service: readiness, a sentence of status, the watchdog. Without systemd
// every call does nothing.
#pragma once

#include <chrono>
#include <optional>
#include <string>

namespace reforge::service {

void ready(const std::string& status);
void status(const std::string& sentence);
void stopping();
void alive();  // feeds the watchdog
// How often alive() must be called: half of what the unit allows. Absent: no watchdog.
std::optional<std::chrono::microseconds> watchdog_period();

}  // namespace reforge::service
