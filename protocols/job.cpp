#include "protocols/job.h"

#include <algorithm>
#include <array>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>

#include "protocols/certificate.h"
#include "protocols/sha256.h"

namespace reforge {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr std::uintmax_t kJsonBytesMax = 64u << 20;

struct Bound {
  const char* key;  // in the certificate
  const char* file;
};
constexpr std::array<Bound, 8> kBound = {{{"program", "program.nc"},
                                          {"rig", "rig.json"},
                                          {"initial", "initial.stl"},
                                          {"target", "target.stl"},
                                          {"fixture", "fixture.stl"},
                                          {"reused", "reused.stl"},
                                          {"removed", "removed.stl"},
                                          {"added", "added.stl"}}};

// A device or a pipe in place of a file would block whoever opens it.
Status plain_file(const fs::path& file) {
  std::error_code failed;
  const fs::file_status status = fs::symlink_status(file, failed);
  if (!fs::exists(status)) {
    return Error{Code::kUnreadable, file.string() + ": is missing, so this is no finished job."};
  }
  if (!fs::is_regular_file(status)) {
    return Error{Code::kMalformed, file.string() + ": is no plain file."};
  }
  return Unit{};
}

Result<json> read_json(const fs::path& file) {
  if (Status plain = plain_file(file); !plain) return plain.error();
  std::error_code failed;
  if (fs::file_size(file, failed) > kJsonBytesMax || failed) {
    return Error{Code::kOutOfRange, file.string() + ": is implausibly large."};
  }
  std::ifstream in(file, std::ios::binary);
  json value = json::parse(in, nullptr, false);
  if (!in || !value.is_object()) {
    return Error{Code::kMalformed, file.string() + ": does not hold one JSON object."};
  }
  return value;
}

// Counts the lines, and looks for an M70, which stands at the beginning of its line.
Status survey_program(const fs::path& file, JobFolder& job) {
  std::ifstream in(file, std::ios::binary);
  std::array<char, 65536> buffer;
  std::int64_t lines = 0;
  char last = '\n';
  std::size_t in_line = 0;  // bytes of the line read so far, blanks apart
  std::array<char, 3> begins{};
  while (in.read(buffer.data(), buffer.size()) || in.gcount() > 0) {
    const char* end = buffer.data() + in.gcount();
    for (const char* at = buffer.data(); at != end;) {
      if (in_line < begins.size()) {
        if (*at == '\n') {
          ++lines;
          in_line = 0;
        } else if (*at != ' ' && *at != '\t') {
          begins[in_line++] = *at;
          const std::string_view word(begins.data(), begins.size());
          job.prints = job.prints || (in_line == word.size() && (word == "M70" || word == "m70"));
        }
        ++at;
        continue;
      }
      at = std::find(at, end, '\n');
      if (at == end) break;
      ++at;
      ++lines;
      in_line = 0;
    }
    last = end[-1];
  }
  if (in.bad()) return Error{Code::kUnreadable, file.string() + ": cannot be read to its end."};
  job.lines = lines + (last == '\n' ? 0 : 1);
  return Unit{};
}

// The reasons of an infeasible plan, as one sentence.
std::string reasons_of(const json& infeasible) {
  std::string out = "There is no plan to run";
  const auto reasons = infeasible.is_object() ? infeasible.find("reasons") : infeasible.end();
  if (infeasible.is_object() && reasons != infeasible.end() && reasons->is_array()) {
    for (const json& reason : *reasons) {
      if (reason.is_string()) out += "; " + reason.get<std::string>();
    }
  }
  return out + ".";
}

Status take_certificate(const fs::path& folder, JobFolder& job) {
  const fs::path file = folder / "certificate.json";
  if (Status plain = plain_file(file); !plain) return plain;
  const auto certificate = read_certificate(file);
  if (!certificate) return certificate.error();
  job.mode = certificate->mode;
  job.estimated_s = certificate->seconds;
  if (!certificate->pass) {
    return Error{Code::kNotCertified, file.string() + ": the verifier's verdict is not \"pass\"."};
  }
  for (const Bound& bound : kBound) {
    const fs::path bound_file = folder / bound.file;
    if (Status plain = plain_file(bound_file); !plain) return plain;
    const auto hash = sha256_of_file(bound_file);
    if (!hash) return hash.error();
    const auto certified = certificate->sha256.find(bound.key);
    if (certified == certificate->sha256.end() || certified->second != *hash) {
      return Error{Code::kHashMismatch,
                   bound_file.string() +
                       ": is not the file the certificate was made for; verify the job again."};
    }
    if (std::string_view(bound.key) == "program") job.program_sha256 = *hash;
    if (std::string_view(bound.key) == "rig") job.rig_sha256 = *hash;
  }
  return Unit{};
}

}  // namespace

Result<JobFolder> read_job(const fs::path& folder) {
  std::error_code failed;
  if (!fs::is_directory(folder, failed)) {
    return Error{Code::kUnreadable, folder.string() + ": is no folder that can be read."};
  }
  JobFolder job;
  job.name = (folder.has_filename() ? folder : folder.parent_path()).filename().string();
  const auto plan = read_json(folder / "plan.json");
  if (!plan) return plan.error();
  if (const auto infeasible = plan->find("infeasible"); infeasible != plan->end()) {
    return Error{Code::kNoFeasiblePlan, folder.string() + ": " + reasons_of(*infeasible)};
  }
  if (Status taken = take_certificate(folder, job); !taken) return taken.error();
  if (Status surveyed = survey_program(folder / "program.nc", job); !surveyed) {
    return surveyed.error();
  }
  return job;
}

Result<std::vector<fs::path>> job_files(const fs::path& folder) {
  std::vector<fs::path> files = {"plan.json", "certificate.json"};
  for (const Bound& bound : kBound) files.emplace_back(bound.file);
  std::error_code failed, absent;
  if (fs::is_directory(folder / "blocks", absent)) {
    std::vector<fs::path> blocks;
    for (const auto& entry : fs::directory_iterator(folder / "blocks", failed)) {
      blocks.push_back(fs::path("blocks") / entry.path().filename());
    }
    std::sort(blocks.begin(), blocks.end());
    files.insert(files.end(), blocks.begin(), blocks.end());
  }
  if (failed) return Error{Code::kUnreadable, folder.string() + ": " + failed.message() + "."};
  for (const fs::path& file : files) {
    if (Status plain = plain_file(folder / file); !plain) return plain.error();
  }
  return files;
}

}  // namespace reforge
