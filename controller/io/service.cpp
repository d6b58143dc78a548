#include "controller/io/service.h"

#include <fcntl.h>
#include <spdlog/sinks/base_sink.h>
#include <sys/uio.h>
#include <systemd/sd-daemon.h>
#include <systemd/sd-journal.h>

#include <atomic>
#include <map>
#include <mutex>
#include <vector>

namespace reforge::service {
namespace {

std::atomic<std::int64_t> current_job{0};
std::atomic<std::int64_t> current_line{0};

std::map<std::string, int> received_handles() {
  std::map<std::string, int> out;
  char** names = nullptr;
  const int count = sd_listen_fds_with_names(1, &names);
  for (int i = 0; i < count; ++i) {
    const int handle = SD_LISTEN_FDS_START + i;
    fcntl(handle, F_SETFD, FD_CLOEXEC);
    out.emplace(names[i], handle);
  }
  for (int i = 0; names != nullptr && i < count; ++i) free(names[i]);
  free(names);
  return out;
}

int priority_of(spdlog::level::level_enum level) {
  switch (level) {
    case spdlog::level::critical:
      return 2;
    case spdlog::level::err:
      return 3;
    case spdlog::level::warn:
      return 4;
    case spdlog::level::info:
      return 6;
    default:
      return 7;
  }
}

class JournalSink final : public spdlog::sinks::base_sink<std::mutex> {
  void sink_it_(const spdlog::details::log_msg& record) override {
    std::vector<std::string> fields = {
        "MESSAGE=" + std::string(record.payload.data(), record.payload.size()),
        "PRIORITY=" + std::to_string(priority_of(record.level)), "SYSLOG_IDENTIFIER=reforged"};
    if (const std::int64_t job = current_job; job > 0) {
      fields.push_back("JOB_ID=" + std::to_string(job));
      fields.push_back("LINE=" + std::to_string(current_line));
    }
    std::vector<iovec> parts;
    for (std::string& field : fields) parts.push_back({field.data(), field.size()});
    sd_journal_sendv(parts.data(), static_cast<int>(parts.size()));
  }
  void flush_() override {}
};

}  // namespace

void ready(const std::string& status) {
  sd_notify(0, ("READY=1\nSTATUS=" + status).c_str());
}

void status(const std::string& sentence) {
  sd_notify(0, ("STATUS=" + sentence).c_str());
}

void reloading() {
  sd_notify(0, "RELOADING=1");
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

std::optional<int> inherited(const std::string& name) {
  static std::map<std::string, int> handles = received_handles();
  const auto found = handles.find(name);
  if (found == handles.end()) return std::nullopt;
  const int handle = found->second;
  handles.erase(found);
  return handle;
}

void keep(const std::string& name, int handle) {
  const std::string what = "FDSTORE=1\nFDNAME=" + name;
  sd_pid_notify_with_fds(0, 0, what.c_str(), &handle, 1);
}

void forget(const std::string& name) {
  sd_notify(0, ("FDSTOREREMOVE=1\nFDNAME=" + name).c_str());
}

spdlog::sink_ptr journal_sink() {
  return std::make_shared<JournalSink>();
}

void job_is(std::int64_t job, std::int64_t line) {
  current_job = job;
  current_line = line;
}

}  // namespace reforge::service
