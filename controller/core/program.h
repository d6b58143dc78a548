// The program as the core pulls it: text by line number, so that a job of ten million lines is
// never held whole.
//
// Lines are numbered from 1 as in the file, blank lines and comments included: every number in a
// status, a journal or a sentence is one an editor shows.
#pragma once

#include <cstdint>
#include <string_view>

#include "protocols/result.h"

namespace reforge {

using LineNumber = std::int64_t;  // 0: none yet

class ProgramSource {
 public:
  virtual ~ProgramSource() = default;

  virtual LineNumber line_count() const = 0;

  // The text of line n, 1 <= n <= line_count(), without its line end; valid until the next call.
  // Asked for in rising order while a job runs. Must not block for long: it is on the hot path.
  virtual Result<std::string_view> line(LineNumber n) = 0;
};

}  // namespace reforge
