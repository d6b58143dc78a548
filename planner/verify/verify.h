// The proof: the very program, simulated by a reader that knows nothing of the planner.
//
// verify_program runs a program text against a rig and meshes; verify_job takes them from a job
// folder as they were written, so that the planner, the command line and the daemon reach the same
// bytes. A program passes exactly if there is no finding. Inputs in the part frame, mm.
//
// Limits: the stock's columns are `pitch` apart (0.1 mm; 0.2 mm for parts with more than 12 million
// columns), bodies are tested there and not between; beads are stadiums of constant section; a
// surface that was left too large is reported as deviation, and is a finding only where it is a
// lump that the tools could have removed.
#pragma once

#include <filesystem>
#include <functional>
#include <istream>
#include <optional>
#include <string>

#include "planner/geometry/mesh.h"
#include "planner/verify/findings.h"
#include "planner/verify/part_outcome.h"
#include "planner/verify/replay.h"
#include "protocols/certificate.h"
#include "protocols/rig.h"

namespace reforge {

struct VerifyInputs {
  RigDescription rig;
  Mode mode = Mode::kStrict;
  TriangleMesh initial;
  std::optional<TriangleMesh> target;
  std::optional<TriangleMesh> reused, removed, added;  // V_R, V_S, V_A
  std::optional<TriangleMesh> fixture;
  std::string initial_sha256;  // compared with the program's header when not empty
};

struct VerifyOptions {
  double pitch_mm = 0;  // 0: by the part's size
  std::function<void(std::size_t line)> progress;
  std::function<bool()> should_stop;  // then the answer is kInterrupted
};

struct Verification {
  bool pass = false;
  double pitch_mm = 0;
  verify::Findings findings;
  verify::ReplayOutcome program;
  verify::PartOutcome part;
  std::map<std::string, double> clearance_mm;
  double left_over_lumps_mm3 = 0;  // could have been milled away (if V_R is given)
};

// Errors: kInterrupted, kUnreadable. A faulty program is an answer, not an error.
Result<Verification> verify_program(std::istream& program, const VerifyInputs& inputs,
                                    const VerifyOptions& options);

// The certificate's content; the caller adds the hashes.
Certificate certificate_of(const Verification& verification, const VerifyInputs& inputs);

struct JobVerification {
  Verification verification;
  Certificate certificate;  // with hashes
};

// Reads rig.json, the meshes and program.nc of a job folder (mode as the program's header says) and
// verifies. Errors name the file.
Result<JobVerification> verify_job(const std::filesystem::path& job, const VerifyOptions& options);

}  // namespace reforge
