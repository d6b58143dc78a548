// What a subcommand of `reforge` ends as: the exit code, and the sentence on stderr when it is not
// 0.
#pragma once

#include "protocols/result.h"

namespace reforge {

enum class ExitCode { kOk = 0, kInfeasibleOrRefused = 1, kUsage = 2, kBadInput = 3, kDevice = 4 };

struct Outcome {
  ExitCode code = ExitCode::kOk;
};

// The exit code that belongs to an error.
ExitCode exit_code_of(Code code);
// Prints `reforge: <sentence>` on stderr and sets the code.
void report(Outcome& outcome, const Error& error);

}  // namespace reforge
