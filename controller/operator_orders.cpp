// The operators' side of the daemon's loop: what they ask, and what they are told.
#include <cassert>

#include "controller/daemon_loop.h"
#include "controller/reports.h"

namespace reforge {

using nlohmann::json;

void Daemon::obey(Call call) {
  api::Params params(call.params);
  if (call.method == api::Method::kSubmit) {
    const std::string path = params.text("path");
    if (!params.fault().empty()) {
      call.answer(api::Failure{api::kInvalidParams, params.fault()});
    } else if (!journal_trouble_.empty()) {
      call.answer(answer_of({Code::kJournal, journal_trouble_}));
    } else {
      queue_.submit(path, call.peer.who, [this, call](const Result<JobId>& job) {
        record(journal_, call, job ? "ok" : job.error().sentence);
        call.answer(job ? job_and_state(*job) : answer_of(job.error()));
      });
    }
    return;
  }
  if (call.method == api::Method::kConfirm || call.method == api::Method::kAdmit) {
    return obey_later(call, params);
  }
  if (call.method == api::Method::kRecover) return recover(call, params);
  const Answer answer = obey_now(call, params);
  if (api::role_needed(call.method) > api::Role::kObserve) {
    const auto* failure = std::get_if<api::Failure>(&answer);
    record(journal_, call, failure == nullptr ? "ok" : failure->sentence);
  }
  call.answer(answer);
}

// Answered when the journal has it, or the files have been read again.
void Daemon::obey_later(const Call& call, api::Params& params) {
  const JobId job{params.number("job", 1, INT64_MAX)};
  std::vector<std::string> items;
  std::string why;
  if (call.method == api::Method::kConfirm) {
    items = params.texts("items", 16);
  } else {
    why = params.text("reason", 500);
  }
  const auto done = [this, call, job](const Status& outcome) {
    record(journal_, call, outcome ? "ok" : outcome.error().sentence);
    if (!outcome) return call.answer(answer_of(outcome.error()));
    call.answer(Answer(json(to_json(queue_.report(job)))));
  };
  if (!params.fault().empty()) {
    call.answer(api::Failure{api::kInvalidParams, params.fault()});
  } else if (!journal_trouble_.empty()) {
    call.answer(answer_of({Code::kJournal, journal_trouble_}));
  } else if (call.method == api::Method::kConfirm) {
    queue_.confirm(job, items, call.peer.who, done);
  } else if (why.empty()) {
    call.answer(api::Failure{api::kInvalidParams, "Say why the job is admitted."});
  } else {
    queue_.admit(job, why, call.peer.who, done);
  }
}

void Daemon::recover(const Call& call, api::Params& params) {
  const JobId job{params.number("job", 1, INT64_MAX)};
  const std::optional<std::string> word = params.optional_text("bead");
  RecoveryRequest request;
  request.path = params.optional_number("path", 1, INT64_MAX);
  if (word == "removed") request.bead = BeadWord::kRemoved;
  if (word == "accepted") request.bead = BeadWord::kAccepted;
  std::string fault = params.fault();
  if (fault.empty() && word && request.bead == BeadWord::kNone) {
    fault = "The parameter \"bead\" must be \"removed\" or \"accepted\".";
  }
  if (!fault.empty()) return call.answer(api::Failure{api::kInvalidParams, fault});
  if (!journal_trouble_.empty()) return call.answer(answer_of({Code::kJournal, journal_trouble_}));
  queue_.recover(job, request, call.peer.who, [this, call](const auto& made) {
    record(journal_, call, made ? "ok" : made.error().sentence);
    if (!made) return call.answer(answer_of(made.error()));
    call.answer(Answer(json{{"job", static_cast<std::int64_t>(made->job)},
                            {"state", api::name_of(queue_.state(made->job))},
                            {"from_line", made->plan.from},
                            {"first_line", made->plan.first_line},
                            {"preamble", made->plan.preamble},
                            {"sentence", made->plan.sentence}}));
  });
}

Answer Daemon::obey_now(const Call& call, api::Params& params) {
  using api::Method;
  std::optional<std::int64_t> job;
  std::optional<std::string> state;
  bool word = false;
  std::optional<double> celsius;
  switch (call.method) {
    case Method::kStart:
    case Method::kAbort:
      job = params.number("job", 1, INT64_MAX);
      break;
    case Method::kStatus:
      job = params.optional_number("job", 1, INT64_MAX);
      break;
    case Method::kJobs:
      state = params.optional_text("state");
      break;
    case Method::kResume:
      word = params.flag("bead_inspected");
      break;
    case Method::kReheat:
      celsius = params.optional_real("temperature_c", 0, 1000);
      break;
    case Method::kClear:
      word = params.flag("module_may_retreat");
      break;
    default:
      break;
  }
  if (!params.fault().empty()) return api::Failure{api::kInvalidParams, params.fault()};
  switch (call.method) {
    case Method::kStart:
      return start(JobId{*job});
    case Method::kAbort:
      return abort(JobId{*job}, call.peer);
    case Method::kHold:
      return order(HoldOrder{});
    case Method::kResume:
      if (!journal_trouble_.empty()) return answer_of({Code::kJournal, journal_trouble_});
      return order(ResumeOrder{word});
    case Method::kEmergency:
      return order(EmergencyOrder{});
    case Method::kClear:
      return order(ClearOrder{word});
    case Method::kReheat:
      return order(ReheatOrder{celsius});
    case Method::kStatus:
      return status(job);
    case Method::kJobs:
      return jobs(state);
    case Method::kShutdown:
      begin_end("asked by " + call.peer.who);
      return json::object();
    case Method::kHello:
    case Method::kSubscribe:
    case Method::kSubmit:
    case Method::kConfirm:
    case Method::kAdmit:
    case Method::kRecover:
      break;
  }
  assert(!"answered elsewhere");
  return json::object();
}

Answer Daemon::order(const OperatorOrder& what) {
  const Status accepted = core_.order(clock_->now(), what);
  after_core();
  if (!accepted) return answer_of(accepted.error());
  return json{{"rig", to_json(rig_report())}};
}

Answer Daemon::start(JobId job) {
  if (ending_) return answer_of({Code::kRefused, "The daemon is ending."});
  if (!journal_trouble_.empty()) return answer_of({Code::kJournal, journal_trouble_});
  auto what = queue_.order(job);
  if (!what) return answer_of(what.error());
  const Status accepted = core_.order(clock_->now(), StartOrder{std::move(*what)});
  if (accepted) job_began_ = clock_->now();
  after_core();
  if (!accepted) return answer_of(accepted.error());
  return job_and_state(job);
}

Answer Daemon::abort(JobId job, const Peer& peer) {
  if (Status known = queue_.exists(job); !known) return answer_of(known.error());
  if (core_.snapshot().job == job) {
    const Status accepted = core_.order(clock_->now(), AbortOrder{});
    after_core();
    if (!accepted) return answer_of(accepted.error());
  } else if (Status gone = queue_.withdraw(job, peer.who); !gone) {
    return answer_of(gone.error());
  }
  return job_and_state(job);
}

Answer Daemon::job_and_state(JobId job) const {
  return json{{"job", static_cast<std::int64_t>(job)}, {"state", api::name_of(queue_.state(job))}};
}

Answer Daemon::status(std::optional<std::int64_t> job) const {
  json out{{"rig", to_json(rig_report())}, {"job", nullptr}, {"queue", json::array()}};
  std::optional<JobId> shown = queue_.with_rig();
  if (job) {
    shown = JobId{*job};
    if (Status known = queue_.exists(*shown); !known) return answer_of(known.error());
  }
  if (shown) out["job"] = to_json(queue_.report(*shown));
  for (const JobId waiting : queue_.waiting()) {
    out["queue"].push_back(static_cast<std::int64_t>(waiting));
  }
  return out;
}

Answer Daemon::jobs(const std::optional<std::string>& state) const {
  std::optional<api::JobState> only;
  if (state) {
    only = api::job_state_named(*state);
    if (!only) {
      return api::Failure{api::kInvalidParams, "There is no job state \"" + *state + "\"."};
    }
  }
  json out{{"jobs", json::array()}};
  for (const JobId job : queue_.all()) {
    if (!only || queue_.state(job) == *only) out["jobs"].push_back(to_json(queue_.report(job)));
  }
  return out;
}

api::RigReport Daemon::rig_report() const {
  api::RigReport report = report_of(core_.snapshot());
  report.name = rig_.name;
  report.cnc.path = links_->path(Link::kCnc);
  report.extruder.path = links_->path(Link::kExtruder);
  if (!report.cnc.up) report.cnc.detail = links_->trouble(Link::kCnc);
  if (!report.extruder.up) report.extruder.detail = links_->trouble(Link::kExtruder);
  if (!journal_trouble_.empty()) report.reason = journal_trouble_;
  report.clock_s = std::chrono::duration<double>(clock_->now() - began_).count();
  return report;
}

}  // namespace reforge
