// The daemon as a systemd service: readiness, a sentence of status, the watchdog, handles that
// outlive it, and records with fields. Without systemd every call does nothing.
#pragma once

#include <spdlog/common.h>

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>

namespace reforge::service {

void ready(const std::string& status);
void status(const std::string& sentence);
void reloading();  // until ready() is called again
void stopping();
void alive();  // feeds the watchdog
// How often alive() must be called: half of what the unit allows. Absent: no watchdog.
std::optional<std::chrono::microseconds> watchdog_period();

// Handles that systemd gave us: a listening socket (socket activation), or what an earlier daemon
// has kept. Each is given out once; what nobody asks for stays open and unused.
std::optional<int> inherited(const std::string& name);
// systemd holds a copy of the handle until forget(), and gives it to the next daemon.
void keep(const std::string& name, int handle);
void forget(const std::string& name);

// Log records for the system's journal, with the fields JOB_ID and LINE while a job has the rig.
spdlog::sink_ptr journal_sink();
void job_is(std::int64_t job, std::int64_t line);  // job 0: none

}  // namespace reforge::service
