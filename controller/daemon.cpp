#include "controller/daemon.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sysexits.h>

#include <boost/asio/io_context.hpp>
#include <cerrno>
#include <cstring>

#include "controller/daemon_loop.h"

namespace reforge {
namespace {

namespace asio = boost::asio;

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

Result<DaemonParts> make_parts(asio::io_context& io, const DaemonConfig& config) {
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
  return DaemonParts{std::move(*rig),   std::move(*cnc),  std::move(clock), virtual_clock,
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

DaemonEnd run_daemon(DaemonConfig config, const std::filesystem::path& file) {
  asio::io_context io;
  auto parts = make_parts(io, config);
  if (!parts) return {exit_code_of(parts.error().code), parts.error().sentence};
  Daemon daemon(io, config, file, std::move(*parts));
  if (Status open = daemon.open_door(); !open) {
    return {exit_code_of(open.error().code), open.error().sentence};
  }
  return daemon.run();
}

}  // namespace reforge
