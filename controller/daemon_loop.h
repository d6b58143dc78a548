// The daemon's loop: one object that stands between core, ports, clock, journal and operators.
//
// Everything happens in the io_context's thread. daemon_loop.cpp carries out the core's actions and
// begins and ends the daemon; operator_orders.cpp answers the operators.
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/asio/steady_timer.hpp>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "controller/core/sequencer.h"
#include "controller/daemon.h"
#include "controller/io/clock.h"
#include "controller/io/journal.h"
#include "controller/io/operator_server.h"
#include "controller/io/rig_links.h"
#include "controller/io/virtual_clock.h"
#include "controller/job_queue.h"

namespace reforge {

// What must exist before the loop, each made or a reason to leave.
struct DaemonParts {
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
  // `config` changes when it is reloaded from `file`.
  Daemon(boost::asio::io_context& io, DaemonConfig& config, std::filesystem::path file,
         DaemonParts parts);
  Status open_door();
  DaemonEnd run();

 private:
  std::unique_ptr<RigLinks> make_links();

  // The core and what it wants.
  void after_core();
  void perform(const Send& action) { links_->perform(action); }
  void perform(const DropUnsent& action) { links_->perform(action); }
  void perform(const Reopen& action) { links_->perform(action); }
  void perform(const RequestHorizon& action);
  void perform(const Acknowledged& action);
  void perform(const JobChanged& action);
  void perform(const StateChanged& action);
  void perform(const Note& action);
  double machine_s() const;

  // The operators.
  void obey(Call call);
  void recover(const Call& call, api::Params& params);
  void obey_later(const Call& call, api::Params& params);
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
  void await_signal();
  void reload();
  bool stream_is_alive() const;
  void feed_watchdog();
  void follow_virtual_clock();
  void begin_end(const std::string& why);
  void end_when_safe();

  boost::asio::io_context& io_;
  DaemonConfig& config_;
  std::filesystem::path config_file_;
  RigDescription rig_;
  std::unique_ptr<Clock> clock_;
  VirtualClock* virtual_clock_;
  Journal journal_;
  JobQueue queue_;
  Sequencer core_;
  std::unique_ptr<RigLinks> links_;
  std::unique_ptr<OperatorServer> door_;
  boost::asio::signal_set signals_;
  boost::asio::steady_timer progress_timer_;
  boost::asio::steady_timer watchdog_timer_;
  boost::asio::steady_timer end_timer_;
  Instant began_;
  Instant job_began_{};
  std::string journal_trouble_;
  std::string progress_told_;
  bool performing_ = false;
  int horizons_awaited_ = 0;  // asked for, not yet durable
  bool ending_ = false;
  DaemonEnd end_;
};

}  // namespace reforge
