#include "controller/daemon_loop.h"

#include <spdlog/spdlog.h>
#include <sysexits.h>

#include <boost/asio/post.hpp>
#include <csignal>
#include <cstring>
#include <random>

#include "controller/io/rig_ports.h"
#include "controller/io/service.h"
#include "controller/io/simulated_rig.h"
#include "controller/reports.h"
#include "protocols/extruder_wire.h"

namespace reforge {
namespace {

namespace asio = boost::asio;
using boost::system::error_code;
using nlohmann::json;

constexpr auto kProgressPeriod = std::chrono::milliseconds(100);  // of wall time: it is for people
constexpr auto kStreamOverdue = std::chrono::seconds(2);
constexpr auto kEndPatience = std::chrono::seconds(10);  // for the core to end a job

CoreOptions core_options(const DaemonConfig& config) {
  std::random_device random;
  CoreOptions options;
  options.ports_are_virtual = config.virtual_ports();
  options.extruder_session = static_cast<std::uint16_t>(1 + random() % 0xFFFF);
  return options;
}

}  // namespace

Daemon::Daemon(asio::io_context& io, DaemonConfig& config, std::filesystem::path file,
               DaemonParts parts)
    : io_(io),
      config_(config),
      config_file_(std::move(file)),
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
      links_(make_links()),
      signals_(io, SIGTERM, SIGINT, SIGHUP),
      progress_timer_(io),
      watchdog_timer_(io),
      end_timer_(io),
      began_(clock_->now()) {
  const bool interrupted = queue_.load(std::move(parts.jobs));
  if (interrupted || parts.rig_left_suspended) core_.recover_interrupted();
}

std::unique_ptr<RigLinks> Daemon::make_links() {
  RigLinks::Handlers handlers{[this](Link link) {
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
                              }};
  if (config_.backend == Backend::kSimulated) {
    return std::make_unique<SimulatedRig>(rig_, *clock_, std::move(handlers));
  }
  return std::make_unique<RigPorts>(
      io_, *clock_, virtual_clock_,
      RigPorts::Port{config_.cnc.path.string(), rig_.cnc.baud, service::inherited("CNC")},
      RigPorts::Port{config_.extruder.path.string(), static_cast<int>(wire::kBaud),
                     service::inherited("extruder")},
      std::move(handlers));
}

Status Daemon::open_door() {
  auto door = OperatorServer::listen(
      io_,
      {config_.socket, static_cast<std::size_t>(config_.clients_max), role_mapping(config_),
       json{{"daemon", "reforged " REFORGE_VERSION}, {"rig", rig_.name}},
       service::inherited("reforged.socket")},
      [this](Call call) { obey(std::move(call)); });
  if (!door) return door.error();
  door_ = std::move(*door);
  return Unit{};
}

DaemonEnd Daemon::run() {
  await_signal();
  links_->begin();
  queue_.begin_verifying();
  if (virtual_clock_ != nullptr) follow_virtual_clock();
  feed_watchdog();
  tell_progress();
  service::ready("Waiting for the rig.");
  spdlog::info("reforged {} runs the rig {} for operators at {}.", REFORGE_VERSION, rig_.name,
               config_.socket.string());
  io_.run();
  door_.reset();
  links_->end();
  return end_;
}

void Daemon::await_signal() {
  signals_.async_wait([this](const error_code& failed, int signal) {
    if (failed) return;
    if (signal == SIGHUP) {
      reload();
    } else {
      begin_end(std::string("signal ") + strsignal(signal));
    }
    await_signal();
  });
}

void Daemon::reload() {
  service::reloading();
  const auto fresh = read_config(config_file_);
  if (!fresh) {
    perform(Note{Note::Level::kError, "Not reloaded: " + fresh.error().sentence});
  } else {
    config_.observe = fresh->observe;
    config_.operate = fresh->operate;
    config_.administer = fresh->administer;
    const bool free = !has_job(core_.snapshot().state);
    if (free) {
      config_.clients_max = fresh->clients_max;
      config_.waiting_jobs_max = fresh->waiting_jobs_max;
      config_.verifier = fresh->verifier;
    }
    door_->set_policy(static_cast<std::size_t>(config_.clients_max), role_mapping(config_));
    perform(Note{Note::Level::kInfo,
                 free ? "Roles, bounds and verifier are those of " + config_file_.string() + "."
                      : "Roles are those of " + config_file_.string() +
                            "; a job has the rig, so bounds and verifier stay as they were."});
  }
  service::ready(std::string(name(core_.snapshot().state)) + ".");
}

void Daemon::follow_virtual_clock() {
  virtual_clock_->run({[this](std::uint64_t cnc, std::uint64_t extruder) {
                         return links_->has_read(cnc, extruder);
                       },
                       // While the journal is in trouble nothing would ever become durable.
                       [this] { return horizons_awaited_ > 0 && !journal_.in_trouble(); },
                       [this] { return links_->counts(); },
                       [this] { return !has_job(core_.snapshot().state); },
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
  ++horizons_awaited_;
  journal_.write(journal::RaiseHorizon{action.job, action.line}, [this, action](JobId) {
    --horizons_awaited_;
    core_.horizon_durable(clock_->now(), action.job, action.line);
    after_core();
  });
}

void Daemon::perform(const Acknowledged& action) {
  service::job_is(static_cast<std::int64_t>(action.job), action.certainty.acknowledged);
  journal_.write(
      journal::Acknowledge{action.job, action.certainty, core_.snapshot().relayed, machine_s()});
}

void Daemon::perform(const JobChanged& action) {
  service::job_is(static_cast<std::int64_t>(action.job), action.certainty.acknowledged);
  queue_.changed(action, machine_s());
  if (is_over(action.state) || action.state == JobState::kReady) service::job_is(0, 0);
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

// The core is asked again before its deadline, or the stream stands although this loop turns. A
// virtual clock may stand for as long as it likes.
bool Daemon::stream_is_alive() const {
  return virtual_clock_ != nullptr || core_.next_deadline() == kNever ||
         clock_->now() < core_.next_deadline() + kStreamOverdue;
}

void Daemon::feed_watchdog() {
  const auto period = service::watchdog_period();
  if (!period) return;
  if (stream_is_alive()) service::alive();
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

}  // namespace reforge
