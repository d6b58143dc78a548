// A program of ours started by a test: its output goes to a file, and it ends with the test.
#pragma once

#include <sys/types.h>

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace reforge::testing {

class Process {
 public:
  // `environment`: "NAME=value", added to the test's own.
  Process(const std::vector<std::string>& command, const std::vector<std::string>& environment,
          const std::filesystem::path& log);
  ~Process();  // SIGKILL, if it still runs
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  pid_t id() const { return pid_; }
  void send_signal(int signal);
  bool runs();
  // Waits for the end; the exit code, or minus the signal. Nothing after `seconds`.
  std::optional<int> end_within(int seconds);

 private:
  pid_t pid_;
  std::optional<int> end_;
};

}  // namespace reforge::testing
