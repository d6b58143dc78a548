#include "tools/reforge/watch.h"

#include <unistd.h>

#include <cstdio>

namespace reforge {
namespace {

using api::JobState;
using nlohmann::json;

Result<api::JobReport> report_of(DaemonLink& link, std::int64_t job) {
  const auto status = link.call(api::Method::kStatus, {{"job", job}});
  if (!status) return status.error();
  return api::job_report(status->value("job", json()));
}

// The job that has the rig, else the newest.
Result<std::int64_t> job_to_watch(DaemonLink& link) {
  const auto status = link.call(api::Method::kStatus, json::object());
  if (!status) return status.error();
  if (const json job = status->value("job", json()); job.is_object()) return job.value("job", 0);
  const auto jobs = link.call(api::Method::kJobs, json::object());
  if (!jobs) return jobs.error();
  const json list = jobs->value("jobs", json::array());
  if (list.empty()) return Error{Code::kNoSuchJob, "The daemon knows no job."};
  return list.back().value("job", std::int64_t{0});
}

// One line that follows the job; on a terminal it stays in its place.
class Display {
 public:
  explicit Display(bool as_json)
      : as_json_(as_json), in_place_(!as_json && isatty(STDOUT_FILENO) == 1) {}

  void raw(const Notification& note) {
    if (!as_json_) return;
    std::printf("%s\n", json({{"method", note.method}, {"params", note.params}}).dump().c_str());
    std::fflush(stdout);
  }

  void state(const api::JobReport& job) {
    if (as_json_) return;
    clear();
    std::printf("job %lld is %s%s%s\n", static_cast<long long>(job.job), api::name_of(job.state),
                job.reason.empty() ? "" : ": ", job.reason.c_str());
    if (job.uncertain) {
      std::printf("lines %lld to %lld may or may not have been sent\n",
                  static_cast<long long>(job.uncertain->first),
                  static_cast<long long>(job.uncertain->last));
    }
    std::fflush(stdout);
  }

  void progress(const api::Progress& p) {
    if (as_json_) return;
    const int percent = p.lines > 0 ? static_cast<int>(100 * p.acknowledged / p.lines) : 0;
    // Without a terminal a line for each twentieth is enough.
    if (!in_place_ && percent / 5 == shown_twentieth_) return;
    shown_twentieth_ = percent / 5;
    char temperature[32] = "? C";
    if (p.temperature_c) {
      std::snprintf(temperature, sizeof temperature, "%.1f C", *p.temperature_c);
    }
    std::printf("%s%3d %%  line %lld of %lld  %s  %s  %.1f s  %lld toggles%s",
                in_place_ ? "\r\033[K" : "", percent, static_cast<long long>(p.acknowledged),
                static_cast<long long>(p.lines), api::name_of(p.state), temperature, p.machine_s,
                static_cast<long long>(p.toggles), in_place_ ? "" : "\n");
    std::fflush(stdout);
  }

  void log(const json& params) {
    if (as_json_ || params.value("level", "info") == "info") return;
    clear();
    std::printf("%s\n", params.value("sentence", "").c_str());
  }

 private:
  void clear() {
    if (in_place_) std::printf("\r\033[K");
  }

  bool as_json_;
  bool in_place_;
  int shown_twentieth_ = -1;
};

}  // namespace

Status wait_until_verified(DaemonLink& link, std::int64_t job) {
  if (const auto subscribed = link.call(api::Method::kSubscribe, json::object()); !subscribed) {
    return subscribed.error();
  }
  const auto now = report_of(link, job);
  if (!now) return now.error();
  JobState state = now->state;
  while (state < JobState::kReady) {
    const auto note = link.next();
    if (!note) return note.error();
    if (note->method != "job" || note->params.value("job", 0LL) != job) continue;
    const auto changed = api::job_report(note->params);
    if (!changed) return changed.error();
    state = changed->state;
  }
  return Unit{};
}

Status watch(DaemonLink& link, std::int64_t job, bool as_json, Outcome& outcome) {
  if (const auto subscribed = link.call(api::Method::kSubscribe, json::object()); !subscribed) {
    return subscribed.error();
  }
  if (job == 0) {
    const auto found = job_to_watch(link);
    if (!found) return found.error();
    job = *found;
  }
  auto last = report_of(link, job);
  if (!last) return last.error();
  Display display(as_json);
  display.raw({"job", to_json(*last)});
  display.state(*last);
  while (!is_over(last->state)) {
    const auto note = link.next();
    if (!note) return note.error();
    display.raw(*note);
    if (note->method == "log") display.log(note->params);
    if (note->params.value("job", 0LL) != job) continue;
    if (note->method == "job") {
      last = api::job_report(note->params);
      if (!last) return last.error();
      display.state(*last);
    } else if (note->method == "progress") {
      const auto progress = api::progress(note->params);
      if (!progress) return progress.error();
      display.progress(*progress);
    }
  }
  if (last->state == JobState::kAborted) outcome.code = ExitCode::kInfeasibleOrRefused;
  if (last->state == JobState::kFailed || last->state == JobState::kInterrupted) {
    outcome.code = ExitCode::kDevice;
  }
  return Unit{};
}

}  // namespace reforge
