#include "controller/io/child_process.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <boost/asio/steady_timer.hpp>
#include <cassert>
#include <cerrno>
#include <cstring>
#include <string_view>

namespace reforge {
namespace {

namespace asio = boost::asio;
using boost::system::error_code;

constexpr std::size_t kKeptBytes = 4096;
constexpr int kWallFactor = 4;

// Between fork and exec: only what is async-signal-safe.
[[noreturn]] void become(char* const* arguments, const ChildLimits& limits, int out) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  const auto limit = [](__rlimit_resource what, rlim_t value) {
    const rlimit both{value, value};
    setrlimit(what, &both);
  };
  limit(RLIMIT_CORE, 0);
  if (limits.memory_mib) limit(RLIMIT_AS, static_cast<rlim_t>(*limits.memory_mib) << 20);
  if (limits.seconds) limit(RLIMIT_CPU, static_cast<rlim_t>(*limits.seconds));
  sigset_t none;
  sigemptyset(&none);
  sigprocmask(SIG_SETMASK, &none, nullptr);
  const int null = open("/dev/null", O_RDWR);
  setpriority(PRIO_PROCESS, 0, 10);  // streaming comes first
  if (null >= 0 && dup2(null, 0) >= 0 && dup2(null, 1) >= 0 && dup2(out, 2) >= 0) {
    std::array<char*, 2> environment = {const_cast<char*>("LC_ALL=C.UTF-8"), nullptr};
    execve(arguments[0], arguments, environment.data());
  }
  constexpr std::string_view kWhy = "the program cannot be executed";
  if (write(2, kWhy.data(), kWhy.size()) < 0) _exit(126);
  _exit(127);
}

std::string last_line_of(std::string text) {
  while (!text.empty() && (text.back() == '\n' || text.back() == '\r')) text.pop_back();
  const std::size_t newline = text.rfind('\n');
  return newline == std::string::npos ? text : text.substr(newline + 1);
}

}  // namespace

struct ChildProcess::Impl : std::enable_shared_from_this<Impl> {
  Impl(asio::io_context& io, std::function<void(ChildOutcome)> called)
      : on_end(std::move(called)), output(io), exit(io), overdue(io) {}

  std::function<void(ChildOutcome)> on_end;
  asio::posix::stream_descriptor output;
  asio::posix::stream_descriptor exit;  // the pidfd: readable once it has ended
  asio::steady_timer overdue;
  pid_t pid = -1;
  bool killed_as_overdue = false;
  std::array<char, 4096> buffer{};
  std::string said;

  void listen() {
    output.async_read_some(asio::buffer(buffer),
                           [self = shared_from_this()](const error_code& failed, std::size_t n) {
                             if (failed) return;
                             self->said.append(self->buffer.data(), n);
                             if (self->said.size() > kKeptBytes) {
                               self->said.erase(0, self->said.size() - kKeptBytes);
                             }
                             self->listen();
                           });
  }

  void await_exit() {
    exit.async_wait(asio::posix::stream_descriptor::wait_read,
                    [self = shared_from_this()](const error_code& failed) {
                      if (!failed) self->ended();
                    });
  }

  void ended() {
    int status = 0;
    waitpid(pid, &status, 0);
    pid = -1;
    error_code ignored;
    overdue.cancel(ignored);
    drain();
    output.close(ignored);
    exit.close(ignored);
    if (!on_end) return;
    ChildOutcome outcome;
    outcome.last_line = last_line_of(said);
    if (WIFEXITED(status)) {
      outcome.exit_code = WEXITSTATUS(status);
    } else if (killed_as_overdue) {
      outcome.sentence = "it took too long and was ended";
    } else if (WTERMSIG(status) == SIGXCPU || WTERMSIG(status) == SIGKILL) {
      outcome.sentence = "it used up its processor time or memory and was ended";
    } else {
      outcome.sentence = std::string("it crashed (") + strsignal(WTERMSIG(status)) + ")";
    }
    on_end(std::move(outcome));
  }

  // What it said last may still stand in the pipe.
  void drain() {
    while (true) {
      const ssize_t n = ::read(output.native_handle(), buffer.data(), buffer.size());
      if (n <= 0) return;
      said.append(buffer.data(), static_cast<std::size_t>(n));
    }
  }
};

Result<std::unique_ptr<ChildProcess>> ChildProcess::run(asio::io_context& io,
                                                        const std::vector<std::string>& command,
                                                        const ChildLimits& limits,
                                                        std::function<void(ChildOutcome)> on_end) {
  assert(!command.empty());
  std::vector<char*> arguments;
  for (const std::string& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  std::array<int, 2> pipe_ends{};
  if (pipe2(pipe_ends.data(), O_CLOEXEC | O_NONBLOCK) != 0) {
    return Error{Code::kBusy, std::string("No pipe for a child: ") + std::strerror(errno) + "."};
  }
  const pid_t pid = fork();
  if (pid == 0) become(arguments.data(), limits, pipe_ends[1]);
  const int why = errno;
  ::close(pipe_ends[1]);
  if (pid < 0) {
    ::close(pipe_ends[0]);
    return Error{Code::kBusy, std::string("No child process: ") + std::strerror(why) + "."};
  }
  const auto impl = std::make_shared<Impl>(io, std::move(on_end));
  impl->pid = pid;
  impl->output.assign(pipe_ends[0]);
  const int exit = static_cast<int>(syscall(SYS_pidfd_open, pid, 0));
  if (exit < 0) {
    const std::string reason = std::strerror(errno);
    kill(pid, SIGKILL);
    waitpid(pid, nullptr, 0);
    return Error{Code::kBusy, "A child process cannot be watched: " + reason + "."};
  }
  impl->exit.assign(exit);
  impl->listen();
  impl->await_exit();
  if (limits.seconds) {
    impl->overdue.expires_after(std::chrono::seconds(kWallFactor * *limits.seconds));
    impl->overdue.async_wait([impl](const error_code& failed) {
      if (failed || impl->pid < 0) return;
      impl->killed_as_overdue = true;
      kill(impl->pid, SIGKILL);
    });
  }
  return std::unique_ptr<ChildProcess>(new ChildProcess(impl));
}

ChildProcess::ChildProcess(std::shared_ptr<Impl> impl) : impl_(std::move(impl)) {}

ChildProcess::~ChildProcess() {
  impl_->on_end = {};
  if (impl_->pid < 0) return;
  kill(impl_->pid, SIGKILL);
  waitpid(impl_->pid, nullptr, 0);
  impl_->pid = -1;
  error_code ignored;
  impl_->overdue.cancel(ignored);
  impl_->output.close(ignored);
  impl_->exit.close(ignored);
}

}  // namespace reforge
