#include "tools/reforge/outcome.h"

#include <cstdio>

namespace reforge {

ExitCode exit_code_of(Code code) {
  switch (code) {
    case Code::kUnreadable:
    case Code::kMalformed:
    case Code::kUnknownKey:
    case Code::kOutOfRange:
    case Code::kWrongVersion:
    case Code::kBadMesh:
    case Code::kDoesNotFit:
      return ExitCode::kBadInput;
    case Code::kHashMismatch:
    case Code::kBooleanFailed:
    case Code::kNoFeasiblePlan:
    case Code::kUnreachable:
    case Code::kInterrupted:
    case Code::kNotCertified:
    case Code::kRefused:
    case Code::kNotAllowed:
    case Code::kNoSuchJob:
      return ExitCode::kInfeasibleOrRefused;
    case Code::kDevice:
    case Code::kJournal:
    case Code::kBusy:
      return ExitCode::kDevice;
    case Code::kUsage:
      return ExitCode::kUsage;
  }
  return ExitCode::kDevice;
}

void report(Outcome& outcome, const Error& error) {
  std::fprintf(stderr, "reforge: %s\n", error.sentence.c_str());
  outcome.code = exit_code_of(error.code);
}

}  // namespace reforge
