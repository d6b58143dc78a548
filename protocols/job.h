// A finished job folder, as the daemon takes it in: is it whole, and are its bytes those the
// verifier certified? Format: FORMATS.md, "Job folder" and "certificate.json".
//
// This binds files to the certificate by hash; it does not repeat the verification.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "protocols/result.h"
#include "protocols/rig.h"

namespace reforge {

struct JobFolder {
  std::string name;  // the folder's
  Mode mode = Mode::kStrict;
  std::string program_sha256;
  std::string rig_sha256;
  std::int64_t lines = 0;  // of program.nc
  bool prints = false;     // it has an M70: the extruder module is opened
  double estimated_s = 0;  // by the certificate
};

// Every file of the folder there is a hash for is read and compared. Refusals: no plan
// (infeasible), no certificate, a verdict that is not `pass`, bytes that differ.
Result<JobFolder> read_job(const std::filesystem::path& folder);

// The files a job consists of that are there, relative to the folder. Anything that is no plain
// file is an error: a job is data.
Result<std::vector<std::filesystem::path>> job_files(const std::filesystem::path& folder);

}  // namespace reforge
