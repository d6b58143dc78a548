// The journal's file: SQLite in WAL mode with synchronous=FULL, so that what was committed survives
// the process and the power. Blocking; the daemon uses it through io/journal.h, on its own thread.
//
// Schema: FORMATS.md, "Journal". Times of day are ISO 8601 in UTC.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "controller/core/job.h"
#include "protocols/operator_api.h"
#include "protocols/result.h"

namespace reforge::journal {

// A job as it was submitted.
struct NewJob {
  std::string name;
  std::string folder;  // its directory's name under the state directory
  std::string program_sha256;
  std::string rig_sha256;
  std::string mode;
  std::int64_t lines = 0;
  double estimated_s = 0;
  std::string submitted_by;
  bool prints = false;
  // A job that finishes another: whose, and where its preamble begins (core/recovery_plan.h).
  std::optional<JobId> recovers;
  LineNumber first_line = 1;
};

// A job as the journal knows it.
struct StoredJob {
  JobId id{};
  NewJob submitted;
  std::string submitted_at;
  api::JobState state = api::JobState::kQueued;
  std::string reason;
  std::string changed_at;
  LineCertainty certainty;  // `sent` means nothing unless sent_known
  bool sent_known = false;  // the daemon lived to see the job's end
  std::int64_t toggles = 0;
  double machine_s = 0;
};

// Records, each one fact.
struct AddJob {
  NewJob job;
};
struct ChangeJob {
  JobId job;
  api::JobState state;
  std::string reason;
  std::optional<LineCertainty> certainty;  // with `sent`, as the core reports it
  std::int64_t toggles = 0;
  double machine_s = 0;
};
struct Acknowledge {
  JobId job;
  LineCertainty certainty;
  std::int64_t toggles = 0;
  double machine_s = 0;
};
struct RaiseHorizon {
  JobId job;
  LineNumber line;
};
struct ChangeRig {
  std::string from, to, reason;
};
// A person has confirmed an item of a job's setup checklist.
struct Confirm {
  JobId job;
  std::string item, who;
};
// Who asked for what, with what outcome ("ok", or the refusal's sentence).
struct Act {
  std::string who, method, params, outcome;
};
using Record = std::variant<AddJob, ChangeJob, Acknowledge, RaiseHorizon, ChangeRig, Confirm, Act>;

class Store {
 public:
  // Creates the file, or opens one of this version; a damaged one is refused.
  static Result<Store> open(const std::filesystem::path& file);
  Store(Store&&) noexcept;
  Store& operator=(Store&&) noexcept;
  ~Store();

  Result<std::vector<StoredJob>> jobs();
  // Did the last daemon leave work in the CNC that nobody has cleared since?
  Result<bool> rig_was_left_suspended();
  // All of them or none, durable on return. For each record the number of the job it added, or 0.
  Result<std::vector<JobId>> write(const std::vector<Record>& records);

 private:
  struct Impl;
  explicit Store(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

std::string now_utc();

}  // namespace reforge::journal
