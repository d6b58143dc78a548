#include "controller/job_queue.h"

#include <spdlog/spdlog.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <cassert>
#include <set>

#include "controller/core/recovery.h"
#include "controller/io/program_file.h"

namespace reforge {
namespace {

namespace fs = std::filesystem;
using api::JobState;

std::int64_t number(JobId job) {
  return static_cast<std::int64_t>(job);
}

Checklist fresh_checklist(const journal::StoredJob& job) {
  return {job.submitted.prints, job.submitted.recovers.has_value()};
}

bool waits(JobState state) {
  return state <= JobState::kReady;
}

}  // namespace

JobQueue::JobQueue(boost::asio::io_context& io, const DaemonConfig& config, std::string rig_sha256,
                   Journal& journal, std::function<void(JobId)> on_changed)
    : io_(io),
      config_(config),
      rig_sha256_(std::move(rig_sha256)),
      journal_(journal),
      on_changed_(std::move(on_changed)),
      intake_(io, config.state_directory / "jobs") {}

bool JobQueue::load(std::vector<journal::StoredJob> jobs) {
  bool interrupted = false;
  std::set<std::string> folders;
  for (journal::StoredJob& job : jobs) {
    folders.insert(job.submitted.folder);
    jobs_.emplace(job.id, std::move(job));
  }
  for (auto& [id, job] : jobs_) {
    if (api::has_the_rig(job.state)) {
      interrupted = true;
      enter(id, JobState::kInterrupted, interruption_sentence(job.certainty, job.sent_known));
    } else if (job.state == JobState::kVerifying) {
      enter(id, JobState::kQueued, "The daemon ended while it was being verified.");
    }
  }
  // A copy whose job never reached the journal was never promised to anybody.
  std::error_code failed;
  for (const auto& entry : fs::directory_iterator(config_.state_directory / "jobs", failed)) {
    if (!folders.contains(entry.path().filename().string())) fs::remove_all(entry.path(), failed);
  }
  return interrupted;
}

void JobQueue::begin_verifying() {
  verify_next();
}

fs::path JobQueue::folder_of(const journal::StoredJob& job) const {
  return config_.state_directory / "jobs" / job.submitted.folder;
}

void JobQueue::submit(const std::string& path, const std::string& who,
                      std::function<void(Result<JobId>)> done) {
  if (!fs::path(path).is_absolute()) {
    done(Error{Code::kOutOfRange, "\"" + path + "\": the path of a job must be absolute."});
    return;
  }
  if (static_cast<int>(waiting().size()) + being_taken_in_ >= config_.waiting_jobs_max) {
    done(Error{Code::kBusy, "The queue is full: " + std::to_string(config_.waiting_jobs_max) +
                                " jobs wait already."});
    return;
  }
  ++being_taken_in_;
  intake_.take(path, [this, who, done = std::move(done)](const Result<TakenIn>& taken) {
    --being_taken_in_;
    if (!taken) {
      done(taken.error());
      return;
    }
    std::error_code ignored;
    if (taken->job.rig_sha256 != rig_sha256_) {
      fs::remove_all(config_.state_directory / "jobs" / taken->folder, ignored);
      done(Error{Code::kHashMismatch, "The job was planned for another rig file than " +
                                          config_.rig.string() + "; plan it again for this rig."});
      return;
    }
    add(new_job(*taken, who), done);
  });
}

journal::NewJob JobQueue::new_job(const TakenIn& taken, const std::string& who) {
  journal::NewJob job;
  job.name = taken.job.name;
  job.folder = taken.folder;
  job.program_sha256 = taken.job.program_sha256;
  job.rig_sha256 = taken.job.rig_sha256;
  job.mode = taken.job.mode == Mode::kPaper ? "paper" : "strict";
  job.lines = taken.job.lines;
  job.estimated_s = taken.job.estimated_s;
  job.submitted_by = who;
  job.prints = taken.job.prints;
  return job;
}

void JobQueue::add(journal::NewJob job, std::function<void(Result<JobId>)> done) {
  journal_.write(journal::AddJob{job}, [this, job, done = std::move(done)](JobId id) {
    journal::StoredJob stored;
    stored.submitted = job;
    stored.id = id;
    stored.submitted_at = stored.changed_at = journal::now_utc();
    const LineNumber before = job.first_line - 1;
    stored.certainty = {before, before, before, before};
    jobs_.emplace(id, std::move(stored));
    done(id);
    on_changed_(id);
    verify_next();
  });
}

void JobQueue::recover(JobId id, RecoveryRequest request, const std::string& who,
                       std::function<void(Result<Recovered>)> done) {
  if (Status known = exists(id); !known) return done(known.error());
  const journal::StoredJob& job = jobs_.at(id);
  if (!is_over(job.state) || job.state == JobState::kDone) {
    return done(Error{Code::kRefused, "Only a job that ended early can be recovered; job " +
                                          std::to_string(number(id)) + " is " +
                                          api::name_of(job.state) + "."});
  }
  request.certainty = job.certainty;
  request.sent_known = job.sent_known;
  request.first_line = job.submitted.first_line;
  intake_.recover(
      job.submitted.folder, job.submitted.lines, request,
      [this, id, who, name = job.submitted.name, done](const Result<RecoveredFolder>& made) {
        if (!made) return done(made.error());
        journal::NewJob next = new_job(made->taken, who);
        next.name = name + " from line " + std::to_string(made->plan.from);
        next.recovers = id;
        next.first_line = made->plan.first_line;
        add(next, [plan = made->plan, done](const Result<JobId>& added) {
          if (!added) return done(added.error());
          done(Recovered{*added, plan});
        });
      });
}

Status JobQueue::exists(JobId job) const {
  if (jobs_.contains(job)) return Unit{};
  return Error{Code::kNoSuchJob, "There is no job " + std::to_string(number(job)) + "."};
}

JobState JobQueue::state(JobId job) const {
  return jobs_.at(job).state;
}

Result<JobOrder> JobQueue::order(JobId id) const {
  if (Status known = exists(id); !known) return known.error();
  const journal::StoredJob& job = jobs_.at(id);
  if (job.state != JobState::kReady) {
    const std::string why = job.reason.empty() ? "" : ": " + job.reason;
    return Error{Code::kRefused, "Job " + std::to_string(number(id)) + " is " +
                                     api::name_of(job.state) + ", not ready" + why};
  }
  if (const std::string missing =
          checklists_.contains(id) ? checklists_.at(id).missing() : fresh_checklist(job).missing();
      !missing.empty()) {
    return Error{Code::kRefused, "Job " + std::to_string(number(id)) +
                                     " is not set up: look at the rig and confirm " + missing +
                                     "."};
  }
  const auto program = ProgramFile::open(folder_of(job) / "program.nc", job.submitted.lines);
  if (!program) return program.error();
  return JobOrder{id, job.submitted.name,
                  job.submitted.mode == "paper" ? Mode::kPaper : Mode::kStrict, *program,
                  job.submitted.first_line};
}

Checklist& JobQueue::checklist(JobId id) {
  return checklists_.try_emplace(id, fresh_checklist(jobs_.at(id))).first->second;
}

void JobQueue::confirm(JobId id, const std::vector<std::string>& items, const std::string& who,
                       std::function<void(Status)> done) {
  if (Status known = exists(id); !known) return done(known);
  if (const JobState state = jobs_.at(id).state; !waits(state)) {
    return done(Error{Code::kRefused, "Job " + std::to_string(number(id)) + " is " +
                                          api::name_of(state) + ": nothing is left to confirm."});
  }
  std::vector<std::size_t> places;
  for (const std::string& item : items) {
    const auto place = checklist(id).find(item);
    if (!place) return done(place.error());
    places.push_back(*place);
  }
  if (items.empty()) {
    for (std::size_t i = 0; i < checklist(id).items().size(); ++i) places.push_back(i);
  }
  for (std::size_t i = 0; i < places.size(); ++i) {
    std::function<void(JobId)> durable;
    if (i + 1 == places.size()) {
      durable = [this, id, places, who, done](JobId) {
        if (!waits(jobs_.at(id).state)) {
          return done(Error{Code::kRefused, "The job no longer waits."});
        }
        for (const std::size_t place : places) checklist(id).confirm(place, who);
        on_changed_(id);
        done(Unit{});
      };
    }
    journal_.write(journal::Confirm{id, checklist(id).items()[places[i]].item, who},
                   std::move(durable));
  }
}

void JobQueue::admit(JobId id, const std::string& why, const std::string& who,
                     std::function<void(Status)> done) {
  if (Status known = exists(id); !known) return done(known);
  const journal::StoredJob& job = jobs_.at(id);
  // A job that has run has a horizon.
  if (job.state != JobState::kFailed || job.certainty.horizon >= job.submitted.first_line) {
    return done(Error{Code::kRefused,
                      "Only a job that failed its verification can be admitted; job " +
                          std::to_string(number(id)) + " is " + api::name_of(job.state) + "."});
  }
  intake_.check(job.submitted.folder, [this, id, why, who, done](const Result<JobFolder>& copy) {
    const journal::StoredJob& now = jobs_.at(id);
    if (!copy) return done(copy.error());
    if (now.state != JobState::kFailed || copy->program_sha256 != now.submitted.program_sha256 ||
        copy->rig_sha256 != now.submitted.rig_sha256) {
      return done(Error{Code::kRefused, "The job was changed; submit it again."});
    }
    enter(id, JobState::kReady, "Admitted by " + who + " (" + why + ") although: " + now.reason);
    done(Unit{});
  });
}

Status JobQueue::withdraw(JobId id, const std::string& who) {
  if (Status known = exists(id); !known) return known;
  const journal::StoredJob& job = jobs_.at(id);
  if (!waits(job.state)) {
    return Error{Code::kRefused, "Job " + std::to_string(number(id)) + " is already " +
                                     api::name_of(job.state) + "."};
  }
  if (job.state == JobState::kVerifying && verifying_ == id) {
    verifier_.reset();
    boost::asio::post(io_, [this] { verify_next(); });
  }
  enter(id, JobState::kAborted, "Taken from the queue by " + who + ".");
  return Unit{};
}

void JobQueue::enter(JobId id, JobState state, std::string reason) {
  journal::StoredJob& job = jobs_.at(id);
  job.state = state;
  job.reason = std::move(reason);
  job.changed_at = journal::now_utc();
  journal_.write(journal::ChangeJob{id, state, job.reason, std::nullopt, 0, 0});
  spdlog::info("Job {} ({}): {}. {}", number(id), job.submitted.name, api::name_of(state),
               job.reason);
  on_changed_(id);
}

void JobQueue::verify_next() {
  if (verifier_) return;
  for (auto& [id, job] : jobs_) {
    if (job.state != JobState::kQueued) continue;
    std::vector<std::string> command = config_.verifier.command;
    // Nobody has certified a recovered program before.
    if (job.submitted.recovers) command.emplace_back("--write");
    command.push_back(folder_of(job).string());
    auto child = ChildProcess::run(
        io_, command, {config_.verifier.memory_mib, config_.verifier.seconds},
        [this, job_id = id](const ChildOutcome& outcome) { verifier_ended(job_id, outcome); });
    if (!child) {
      enter(id, JobState::kFailed, "It could not be verified: " + child.error().sentence);
      continue;
    }
    verifier_ = std::move(*child);
    verifying_ = id;
    enter(id, JobState::kVerifying, "");
    return;
  }
}

void JobQueue::verifier_ended(JobId id, const ChildOutcome& outcome) {
  if (!outcome.exit_code) {
    enter(id, JobState::kFailed, "It could not be verified: " + outcome.sentence + ".");
  } else if (*outcome.exit_code != 0) {
    // Without a word it has found the program good, but another certificate than the one submitted.
    enter(id, JobState::kFailed,
          "The verifier refuses it: " +
              (outcome.last_line.empty() ? "the certificate is not the one this verification gives."
                                         : outcome.last_line));
  } else {
    // It has compared its certificate with the copy's; are the files still those, after all that
    // time?
    intake_.check(jobs_.at(id).submitted.folder,
                  [this, id](const Result<JobFolder>& copy) { verified(id, copy); });
  }
  // Not from inside the child's own callback.
  verifying_.reset();
  boost::asio::post(io_, [this] {
    verifier_.reset();
    verify_next();
  });
}

void JobQueue::verified(JobId id, const Result<JobFolder>& copy) {
  const journal::StoredJob& job = jobs_.at(id);
  if (job.state != JobState::kVerifying) return;  // withdrawn meanwhile
  if (!copy) {
    enter(id, JobState::kFailed, copy.error().sentence);
  } else if (copy->program_sha256 != job.submitted.program_sha256 ||
             copy->rig_sha256 != job.submitted.rig_sha256) {
    enter(id, JobState::kFailed, "The job was changed while it was verified.");
  } else {
    enter(id, JobState::kReady, "");
  }
}

void JobQueue::changed(const JobChanged& change, double machine_s) {
  // Whatever was confirmed was confirmed of a rig that no job had touched since.
  if (change.state != JobState::kReady) {
    for (auto& [id, list] : checklists_) list.forget();
  }
  journal::StoredJob& job = jobs_.at(change.job);
  job.state = change.state;
  job.reason = change.sentence;
  job.changed_at = journal::now_utc();
  job.certainty = change.certainty;
  job.sent_known = is_over(change.state);
  job.toggles = change.relayed;
  job.machine_s = machine_s;
  journal_.write(journal::ChangeJob{change.job, change.state, change.sentence, change.certainty,
                                    change.relayed, machine_s});
  spdlog::info("Job {} ({}): {}. {}", number(change.job), job.submitted.name,
               api::name_of(change.state), change.sentence);
  on_changed_(change.job);
}

void JobQueue::journalled(const journal::Acknowledge& lines) {
  journal::StoredJob& job = jobs_.at(lines.job);
  if (is_over(job.state)) return;  // its end says more
  job.certainty = lines.certainty;
  job.toggles = lines.toggles;
  job.machine_s = lines.machine_s;
}

api::JobReport JobQueue::report(JobId id) const {
  const journal::StoredJob& job = jobs_.at(id);
  api::JobReport out;
  out.job = number(id);
  out.name = job.submitted.name;
  out.state = job.state;
  out.reason = job.reason;
  out.mode = job.submitted.mode;
  out.submitted_by = job.submitted.submitted_by;
  out.submitted_at = job.submitted_at;
  out.changed_at = job.changed_at;
  out.program_sha256 = job.submitted.program_sha256;
  out.lines = job.submitted.lines;
  out.executed = job.certainty.executed;
  out.acknowledged = job.certainty.acknowledged;
  out.horizon = job.certainty.horizon;
  out.toggles = job.toggles;
  out.machine_s = job.machine_s;
  out.estimated_s = job.submitted.estimated_s;
  if (job.submitted.recovers) out.recovers = number(*job.submitted.recovers);
  if (is_over(job.state) && job.state != JobState::kDone) {
    out.uncertain = uncertain_lines(job.certainty, job.sent_known);
  }
  if (waits(job.state)) {
    const auto list = checklists_.find(id);
    out.checklist = list != checklists_.end() ? list->second.items() : fresh_checklist(job).items();
  }
  return out;
}

std::vector<JobId> JobQueue::all() const {
  std::vector<JobId> out;
  for (const auto& [id, job] : jobs_) out.push_back(id);
  return out;
}

std::vector<JobId> JobQueue::waiting() const {
  std::vector<JobId> out;
  for (const auto& [id, job] : jobs_) {
    if (waits(job.state)) out.push_back(id);
  }
  return out;
}

std::optional<JobId> JobQueue::with_rig() const {
  for (const auto& [id, job] : jobs_) {
    if (api::has_the_rig(job.state)) return id;
  }
  return std::nullopt;
}

}  // namespace reforge
