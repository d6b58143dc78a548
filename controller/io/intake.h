// Takes a job folder in: checks it against its certificate, copies it into the state directory, and
// checks the copy, so that nothing that happens to the folder later matters. On a thread of its
// own: a big job on a slow disk holds up nobody's stream.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "controller/core/recovery_plan.h"
#include "protocols/job.h"
#include "protocols/result.h"

namespace boost::asio {
class io_context;
}

namespace reforge {

struct TakenIn {
  JobFolder job;
  std::string folder;  // of the copy, under the directory of all copies
};

// A new folder beside the copies: the old job's files with the program that recovers it, and no
// certificate yet.
struct RecoveredFolder {
  TakenIn taken;
  RecoveryPlan plan;
};

class Intake {
 public:
  // Copies go to `directory`, each into a folder with a name of its own.
  Intake(boost::asio::io_context& io, std::filesystem::path directory);
  ~Intake();  // finishes the copy under way, drops the rest

  // `done` is called in the io_context's thread, in the order of the calls.
  void take(const std::filesystem::path& folder, std::function<void(Result<TakenIn>)> done);
  // The same check of a copy again.
  void check(const std::string& copy, std::function<void(Result<JobFolder>)> done);

  // `lines`: of the copy's program.
  void recover(const std::string& copy, LineNumber lines, const RecoveryRequest& request,
               std::function<void(Result<RecoveredFolder>)> done);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace reforge
