#include "controller/daemon.h"

#include <fcntl.h>
#include <spdlog/spdlog.h>
#include <sys/file.h>
#include <sysexits.h>
#include <unistd.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/asio/steady_timer.hpp>
#include <csignal>
#include <random>

#include "controller/core/sequencer.h"
#include "controller/io/journal.h"
#include "controller/io/operator_server.h"
#include "controller/io/rig_ports.h"
#include "controller/io/service.h"
#include "controller/io/virtual_clock.h"
#include "controller/job_queue.h"
#include "controller/reports.h"

namespace reforge {
namespace {

namespace asio = boost::asio;
using boost::system::error_code;
using nlohmann::json;

constexpr auto kProgressPeriod = std::chrono::milliseconds(100);  // of wall time: it is for people
constexpr auto kEndPatience = std::chrono::seconds(10);           // for the core to end a job
constexpr int kExtruderBaud = 115200;                             // wire::kBaud

CoreOptions core_options(const DaemonConfig& config) {
  std::random_device random;
  CoreOptions options;
  options.ports_are_virtual = config.virtual_ports();
  options.extruder_session = static_cast<std::uint16_t>(1 + random() % 0xFFFF);
  return options;
}

// The parts that must exist before the loop, each made or a reason to leave.
struct Parts {
  RigDescription rig;
  std::unique_ptr<CncDevice> cnc;
  std::unique_ptr<Clock> clock;
  VirtualClock* virtual_clock = nullptr;  // the clock, when it is virtual
  journal::Store store;
  std::vector<journal::StoredJob> jobs;
  bool rig_left_suspended = false;
};

class Daemon {
 public:
  Daemon(asio::io_context& io, const DaemonConfig& config, Parts parts);
  Status open_door();
  DaemonEnd run();

 private:
  // The core and what it wants.
  void after_core();
  void perform(const Send& action) { ports_.perform(action); }
  void perform(const DropUnsent& action) { ports_.perform(action); }
  void perform(const Reopen& action) { ports_.perform(action); }
  void perform(const RequestHorizon& action);
  void perform(const Acknowledged& action);
  void perform(const JobChanged& action);
  void perform(const StateChanged& action);
  void perform(const Note& action);
  double machine_s() const;

  // The operators.
  void obey(Call call);
  Answer obey_now(const Call& call, api::Params& params);
  Answer start(JobId job);
  Answer abort(JobId job, const Peer& peer);
  Answer order(const OperatorOrder& what);
  Answer job_and_state(JobId job) const;
  Answer status(std::optional<std::int64_t> job) const;
  Answer jobs(const std::optional<std::string>& state) const;
  api::RigReport rig_report() const;

  void journal_trouble(const std::string& sentence);
  void tell_progress();
  void feed_watchdog();
  void follow_virtual_clock();
  void begin_end(const std::string& why);
  void end_when_safe();

  asio::io_context& io_;
  const DaemonConfig& config_;
  RigDescription rig_;
  std::unique_ptr<Clock> clock_;
  VirtualClock* virtual_clock_;
  Journal journal_;
  JobQueue queue_;
  Sequencer core_;
  RigPorts ports_;
  std::unique_ptr<OperatorServer> door_;
  asio::signal_set signals_;
  asio::steady_timer progress_timer_;
  asio::steady_timer watchdog_timer_;
  asio::steady_timer end_timer_;
  Instant began_;
  Instant job_began_{};
  std::string journal_trouble_;
  std::string progress_told_;
  bool performing_ = false;
  bool ending_ = false;
  DaemonEnd end_;
};

Daemon::Daemon(asio::io_context& io, const DaemonConfig& config, Parts parts)
    : io_(io),
      config_(config),
      rig_(parts.rig),
      clock_(std::move(parts.clock)),
      virtual_clock_(parts.virtual_clock),
      journal_(io, std::move(parts.store),
               {[this](const std::string& sentence) { journal_trouble(sentence); },
                [this](const journal::Acknowledge& lines) { queue_.journalled(lines); }}),
      queue_(io, config, rig_.sha256, journal_,
             [this](JobId job) {
               if (door_) {
                 door_->publish("job", to_json(queue_.report(job)),
                                OperatorServer::Kind::kMustArrive);
               }
             }),
      core_(rig_, std::move(parts.cnc), core_options(config)),
      ports_(io, *clock_, virtual_clock_, {config.cnc.path.string(), rig_.cnc.baud},
             {config.extruder.path.string(), kExtruderBaud},
             {[this](Link link) {
                core_.link_opened(clock_->now(), link);
                after_core();
              },
              [this](Link link, const std::string& why) {
                core_.link_lost(clock_->now(), link, why);
                after_core();
              },
              [this](Link link, std::string_view bytes) {
                core_.receive(clock_->now(), link, bytes);
                after_core();
              },
              [this] {
                if (virtual_clock_ != nullptr) virtual_clock_->wrote();
              }}),
      signals_(io, SIGTERM, SIGINT),
      progress_timer_(io),
      watchdog_timer_(io),
      end_timer_(io),
      began_(clock_->now()) {
  const bool interrupted = queue_.load(std::move(parts.jobs));
  if (interrupted || parts.rig_left_suspended) core_.recover_interrupted();
}

Status Daemon::open_door() {
  auto door = OperatorServer::listen(
      io_,
      {config_.socket, static_cast<std::size_t>(config_.clients_max), role_mapping(config_),
       json{{"daemon", "reforged " REFORGE_VERSION}, {"rig", rig_.name}}},
      [this](Call call) { obey(std::move(call)); });
  if (!door) return door.error();
  door_ = std::move(*door);
  return Unit{};
}

DaemonEnd Daemon::run() {
  signals_.async_wait([this](const error_code& failed, int signal) {
    if (!failed) begin_end(std::string("signal ") + strsignal(signal));
  });
  ports_.begin();
  queue_.begin_verifying();
  if (virtual_clock_ != nullptr) follow_virtual_clock();
  feed_watchdog();
  tell_progress();
  service::ready("Waiting for the rig.");
  spdlog::info("reforged {} runs the rig {} for operators at {}.", REFORGE_VERSION, rig_.name,
               config_.socket.string());
  io_.run();
  door_.reset();
  ports_.end();
  return end_;
}

void Daemon::follow_virtual_clock() {
  virtual_clock_->run(
      {[this](std::uint64_t cnc, std::uint64_t extruder) { return ports_.has_read(cnc, extruder); },
       // While the journal is in trouble nothing would ever become durable.
       [this] { return journal_.awaited() > 0 && !journal_.in_trouble(); },
       [this] { return ports_.counts(); }, [this] { return !has_job(core_.snapshot().state); },
       [this](const std::string& sentence) {
         spdlog::error("{}", sentence);
         end_ = {EX_UNAVAILABLE, sentence};
         io_.stop();
       }});
}

void Daemon::after_core() {
  if (performing_) return;  // the loop below takes what came up meanwhile
  performing_ = true;
  for (auto actions = core_.take_actions(); !actions.empty(); actions = core_.take_actions()) {
    for (const Action& action : actions) {
      std::visit([this](const auto& what) { perform(what); }, action);
    }
  }
  performing_ = false;
  clock_->wake_at(Timer::kCore, core_.next_deadline(), [this] {
    core_.tick(clock_->now());
    after_core();
  });
  if (virtual_clock_ != nullptr) virtual_clock_->progress();
  if (ending_) end_when_safe();
}

void Daemon::perform(const RequestHorizon& action) {
  journal_.write(journal::RaiseHorizon{action.job, action.line}, [this, action](JobId) {
    core_.horizon_durable(clock_->now(), action.job, action.line);
    after_core();
  });
}

void Daemon::perform(const Acknowledged& action) {
  journal_.write(
      journal::Acknowledge{action.job, action.certainty, core_.snapshot().relayed, machine_s()});
}

void Daemon::perform(const JobChanged& action) {
  queue_.changed(action, machine_s());
}

void Daemon::perform(const StateChanged& action) {
  journal_.write(journal::ChangeRig{std::string(name(action.from)), std::string(name(action.to)),
                                    action.sentence});
  spdlog::info("Rig: {} -> {}. {}", name(action.from), name(action.to), action.sentence);
  service::status(std::string(name(action.to)) + ". " + action.sentence);
  if (!door_) return;
  api::RigReport report = rig_report();
  report.state = name(action.to);  // the core may be further by now, and will say so
  report.reason = action.sentence;
  door_->publish("rig", to_json(report), OperatorServer::Kind::kMustArrive);
}

void Daemon::perform(const Note& action) {
  const auto level = action.level == Note::Level::kInfo      ? spdlog::level::info
                     : action.level == Note::Level::kWarning ? spdlog::level::warn
                                                             : spdlog::level::err;
  spdlog::log(level, "{}", action.sentence);
  if (!door_) return;
  const auto text = spdlog::level::to_string_view(level);
  door_->publish("log",
                 {{"level", std::string(text.data(), text.size())}, {"sentence", action.sentence}},
                 OperatorServer::Kind::kMustArrive);
}

double Daemon::machine_s() const {
  return std::chrono::duration<double>(clock_->now() - job_began_).count();
}

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
  const Answer answer = obey_now(call, params);
  if (api::role_needed(call.method) > api::Role::kObserve) {
    const auto* failure = std::get_if<api::Failure>(&answer);
    record(journal_, call, failure == nullptr ? "ok" : failure->sentence);
  }
  call.answer(answer);
}

Answer Daemon::obey_now(const Call& call, api::Params& params) {
  using api::Method;
  std::optional<std::int64_t> job;
  std::optional<std::string> state;
  bool word = false;
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
  report.cnc.path = ports_.path(Link::kCnc);
  report.extruder.path = ports_.path(Link::kExtruder);
  if (!report.cnc.up) report.cnc.detail = ports_.trouble(Link::kCnc);
  if (!report.extruder.up) report.extruder.detail = ports_.trouble(Link::kExtruder);
  if (!journal_trouble_.empty()) report.reason = journal_trouble_;
  report.clock_s = std::chrono::duration<double>(clock_->now() - began_).count();
  return report;
}

void Daemon::journal_trouble(const std::string& sentence) {
  journal_trouble_ = sentence;
  perform(sentence.empty() ? Note{Note::Level::kWarning, "The journal can be written again."}
                           : Note{Note::Level::kError, sentence});
  if (sentence.empty()) return;
  // Refused when nothing moves: then there is nothing to hold.
  const Status held = core_.order(clock_->now(), HoldOrder{});
  if (!held) spdlog::info("{}", held.error().sentence);
  after_core();
}

void Daemon::tell_progress() {
  progress_timer_.expires_after(kProgressPeriod);
  progress_timer_.async_wait([this](const error_code& failed) {
    if (failed) return;
    tell_progress();
    const auto job = queue_.with_rig();
    if (!job || !door_ || door_->subscribers() == 0) return;
    const api::JobReport report = queue_.report(*job);
    const json now = to_json(progress_of(report, core_.snapshot(), machine_s()));
    std::string text = now.dump();
    if (text == progress_told_) return;
    progress_told_ = std::move(text);
    door_->publish("progress", now, OperatorServer::Kind::kMayDrop);
  });
}

void Daemon::feed_watchdog() {
  const auto period = service::watchdog_period();
  if (!period) return;
  service::alive();
  watchdog_timer_.expires_after(*period);
  watchdog_timer_.async_wait([this](const error_code& failed) {
    if (!failed) feed_watchdog();
  });
}

void Daemon::begin_end(const std::string& why) {
  if (ending_) return;
  ending_ = true;
  spdlog::info("The daemon ends: {}.", why);
  service::stopping();
  const Status accepted = core_.order(clock_->now(), ShutdownOrder{});
  if (!accepted) spdlog::warn("{}", accepted.error().sentence);
  end_timer_.expires_after(kEndPatience);
  end_timer_.async_wait([this](const error_code& failed) {
    if (failed) return;
    spdlog::error("The rig did not come to rest in time.");
    io_.stop();
  });
  after_core();
}

// Not from inside whoever called: its answer still has to be sent.
void Daemon::end_when_safe() {
  if (has_job(core_.snapshot().state)) return;
  asio::post(io_, [this] { io_.stop(); });
}

// Kept open, and locked, for as long as the process lives.
Status lock_state_directory(const DaemonConfig& config) {
  std::error_code failed;
  std::filesystem::create_directories(config.state_directory / "jobs", failed);
  const auto file = config.state_directory / "lock";
  const int handle = failed ? -1 : open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
  if (handle < 0) {
    return Error{Code::kUnreadable, config.state_directory.string() +
                                        ": the state directory cannot be used: " +
                                        (failed ? failed.message() : std::strerror(errno)) + "."};
  }
  if (flock(handle, LOCK_EX | LOCK_NB) != 0) {
    return Error{Code::kBusy, config.state_directory.string() + ": another reforged works here."};
  }
  return Unit{};
}

Result<Parts> make_parts(asio::io_context& io, const DaemonConfig& config) {
  auto rig = rig_for(config);
  if (!rig) return rig.error();
  auto cnc = make_cnc_device(rig->cnc);
  if (!cnc) return cnc.error();
  if (Status locked = lock_state_directory(config); !locked) return locked.error();
  auto store = journal::Store::open(config.state_directory / "journal.sqlite");
  if (!store) return store.error();
  auto jobs = store->jobs();
  if (!jobs) return jobs.error();
  auto suspended = store->rig_was_left_suspended();
  if (!suspended) return suspended.error();
  std::unique_ptr<Clock> clock;
  VirtualClock* virtual_clock = nullptr;
  if (config.clock) {
    auto connected = VirtualClock::connect(io, *config.clock);
    if (!connected) return connected.error();
    virtual_clock = connected->get();
    clock = std::move(*connected);
  } else {
    clock = monotonic_clock(io);
  }
  return Parts{std::move(*rig),   std::move(*cnc),  std::move(clock), virtual_clock,
               std::move(*store), std::move(*jobs), *suspended};
}

int exit_code_of(Code code) {
  switch (code) {
    case Code::kUnreadable:
      return EX_NOINPUT;
    case Code::kJournal:
    case Code::kWrongVersion:
      return EX_DATAERR;
    case Code::kBusy:
      return EX_TEMPFAIL;
    case Code::kDevice:
      return EX_UNAVAILABLE;
    default:
      return EX_CONFIG;
  }
}

}  // namespace

Result<RigDescription> rig_for(const DaemonConfig& config) {
  auto rig = read_rig(config.rig);
  if (!rig) return rig;
  if (!config.virtual_ports() && !rig->commissioned) {
    return Error{Code::kRefused,
                 config.rig.string() +
                     ": nobody has commissioned this rig (signs, pivots and travels are assumed), "
                     "so it runs on virtual ports only."};
  }
  return rig;
}

DaemonEnd run_daemon(const DaemonConfig& config) {
  asio::io_context io;
  auto parts = make_parts(io, config);
  if (!parts) return {exit_code_of(parts.error().code), parts.error().sentence};
  Daemon daemon(io, config, std::move(*parts));
  if (Status open = daemon.open_door(); !open) {
    return {exit_code_of(open.error().code), open.error().sentence};
  }
  return daemon.run();
}

}  // namespace reforge
