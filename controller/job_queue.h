// The jobs the daemon knows: taken in, verified, waiting, run, over. A job exists once the journal
// has it, and every state goes there as it is entered; nothing starts by itself.
//
// Verification is the daemon's own: a child process repeats it on the daemon's copy, one job at a
// time in the order of submission, whatever the certificate that came along says.
// Limit: copies of jobs that are over are kept until somebody removes them.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "controller/checklist.h"
#include "controller/config.h"
#include "controller/core/action.h"
#include "controller/core/job.h"
#include "controller/core/recovery_plan.h"
#include "controller/io/child_process.h"
#include "controller/io/intake.h"
#include "controller/io/journal.h"
#include "protocols/operator_api.h"

namespace reforge {

class JobQueue {
 public:
  // `on_changed` is called after a job entered a state.
  JobQueue(boost::asio::io_context& io, const DaemonConfig& config, std::string rig_sha256,
           Journal& journal, std::function<void(JobId)> on_changed);

  // What the journal knows, at start. Jobs that had the rig become interrupted; true if there were.
  bool load(std::vector<journal::StoredJob> jobs);
  void begin_verifying();

  void submit(const std::string& path, const std::string& who,
              std::function<void(Result<JobId>)> done);

  // A new job that finishes one that ended early (core/recovery_plan.h); it is verified and set up
  // like any other before it can be started. `request` needs no certainty: that is the journal's.
  struct Recovered {
    JobId job;
    RecoveryPlan plan;
  };
  void recover(JobId job, RecoveryRequest request, const std::string& who,
               std::function<void(Result<Recovered>)> done);

  Status exists(JobId job) const;
  api::JobState state(JobId job) const;
  // A person has looked at these items of a waiting job's checklist; none named: at all of them.
  // `done` once the journal has it.
  void confirm(JobId job, const std::vector<std::string>& items, const std::string& who,
               std::function<void(Status)> done);
  // The administrator's override: a job that our own verification did not pass becomes ready all
  // the same, if its files are still those of the certificate it came with.
  void admit(JobId job, const std::string& why, const std::string& who,
             std::function<void(Status)> done);
  // A ready job with all its checklist confirmed, as the core takes it.
  Result<JobOrder> order(JobId job) const;
  // A job that has not started leaves the queue.
  Status withdraw(JobId job, const std::string& who);

  // From the core and the journal.
  void changed(const JobChanged& change, double machine_s);
  void journalled(const journal::Acknowledge& lines);

  api::JobReport report(JobId job) const;
  std::vector<JobId> all() const;      // oldest first
  std::vector<JobId> waiting() const;  // queued, verifying or ready
  std::optional<JobId> with_rig() const;

 private:
  static journal::NewJob new_job(const TakenIn& taken, const std::string& who);
  void add(journal::NewJob job, std::function<void(Result<JobId>)> done);
  Checklist& checklist(JobId job);
  void enter(JobId job, api::JobState state, std::string reason);
  void verify_next();
  void verifier_ended(JobId job, const ChildOutcome& outcome);
  void verified(JobId job, const Result<JobFolder>& copy);
  std::filesystem::path folder_of(const journal::StoredJob& job) const;

  boost::asio::io_context& io_;
  const DaemonConfig& config_;
  std::string rig_sha256_;
  Journal& journal_;
  std::function<void(JobId)> on_changed_;
  Intake intake_;
  std::map<JobId, journal::StoredJob> jobs_;
  std::map<JobId, Checklist> checklists_;  // of jobs that wait, once looked at
  int being_taken_in_ = 0;
  std::unique_ptr<ChildProcess> verifier_;
  std::optional<JobId> verifying_;  // whose child runs
};

}  // namespace reforge
