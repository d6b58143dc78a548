// A program run beside the daemon under limits, with an empty environment, and killed with it.
//
// The loop never waits: the outcome comes by a callback in the io_context's thread. stdin and
// stdout are /dev/null; the end of what it says on stderr is kept.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "protocols/result.h"

namespace boost::asio {
class io_context;
}

namespace reforge {

struct ChildLimits {
  std::optional<int> memory_mib;  // of address space
  std::optional<int> seconds;     // of processor time; four times that of wall time
};

struct ChildOutcome {
  std::optional<int> exit_code;  // absent: ended by a signal, or by us for taking too long
  std::string sentence;          // how it ended, when exit_code is absent
  std::string last_line;         // of stderr
};

class ChildProcess {
 public:
  static Result<std::unique_ptr<ChildProcess>> run(boost::asio::io_context& io,
                                                   const std::vector<std::string>& command,
                                                   const ChildLimits& limits,
                                                   std::function<void(ChildOutcome)> on_end);
  // Kills it if it still runs; on_end is not called then.
  ~ChildProcess();

 private:
  struct Impl;
  explicit ChildProcess(std::shared_ptr<Impl> impl);
  std::shared_ptr<Impl> impl_;
};

}  // namespace reforge
