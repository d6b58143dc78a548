#include "controller/io/serial_port.h"

#include <fcntl.h>
#include <libserialport.h>
#include <poll.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <cassert>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <optional>

namespace reforge {
namespace {

namespace asio = boost::asio;
using boost::system::error_code;

// More than any device here may ever have unacknowledged: reaching it means a device that takes no
// bytes at all.
constexpr std::size_t kUnsentMax = 64 * 1024;

constexpr auto kAheadMax = std::chrono::milliseconds(1);
constexpr int kKernelBytes = SerialPort::kKernelBytes;

std::string serial_error(sp_return code) {
  if (code == SP_ERR_FAIL) {
    char* text = sp_last_error_message();
    std::string out = text;
    sp_free_error_message(text);
    return out;
  }
  if (code == SP_ERR_SUPP) return "not supported by the port";
  return "bad argument";
}

// The virtual rig keeps its pseudo-terminals open itself, so TIOCEXCL would outlive us there and
// lock out the next daemon.
bool is_pseudo_terminal(int handle) {
  struct stat about {};
  if (fstat(handle, &about) != 0) return false;
  const unsigned int device = major(about.st_rdev);
  return device >= 136 && device <= 143;  // UNIX98_PTY_SLAVE_MAJOR, eight of them
}

// Held for as long as the port is open; closes it in the end.
struct OpenPort {
  sp_port* port = nullptr;
  int handle = -1;

  ~OpenPort() {
    if (port == nullptr) return;
    sp_close(port);
    sp_free_port(port);
  }
};

// What an earlier daemon held it with; closed in the end, when ours is open.
struct KeptHandle {
  int handle = -1;
  ~KeptHandle() {
    if (handle >= 0) ::close(handle);
  }
};

Status configure(OpenPort& open, const std::string& path, const SerialPort::How& how) {
  const int baud = how.baud;
  const KeptHandle kept{how.kept.value_or(-1)};
  if (kept.handle >= 0) {
    flock(kept.handle, LOCK_UN);
    ioctl(kept.handle, TIOCNXCL);
  }
  const auto failed = [&](const std::string& what, const std::string& why) -> Status {
    return Error{Code::kDevice, path + ": " + what + ": " + why + "."};
  };
  // libserialport knows only the kernel's own names; ours are links to them.
  std::error_code missing;
  const std::filesystem::path device = std::filesystem::canonical(path, missing);
  if (missing) return failed("is not there", missing.message());
  sp_return code = sp_get_port_by_name(device.c_str(), &open.port);
  if (code != SP_OK) return failed("is no serial port", serial_error(code));
  code = sp_open(open.port, SP_MODE_READ_WRITE);
  if (code != SP_OK) return failed("cannot be opened", serial_error(code));
  code = sp_get_port_handle(open.port, &open.handle);
  if (code != SP_OK) return failed("has no handle", serial_error(code));
  if (flock(open.handle, LOCK_EX | LOCK_NB) != 0 ||
      (!is_pseudo_terminal(open.handle) && ioctl(open.handle, TIOCEXCL) != 0)) {
    return failed("is in use by another program", std::strerror(errno));
  }
  for (const sp_return set :
       {sp_set_baudrate(open.port, baud), sp_set_bits(open.port, 8),
        sp_set_parity(open.port, SP_PARITY_NONE), sp_set_stopbits(open.port, 1),
        sp_set_flowcontrol(open.port, SP_FLOWCONTROL_NONE)}) {
    if (set != SP_OK) {
      return failed("cannot be set to " + std::to_string(baud) + " baud, 8N1", serial_error(set));
    }
  }
  termios settings{};
  if (tcgetattr(open.handle, &settings) != 0)
    return failed("cannot be set up", std::strerror(errno));
  settings.c_cflag &= ~static_cast<tcflag_t>(HUPCL);
  settings.c_cc[VMIN] = 1;  // libserialport leaves 0, and every read of nothing looks like an end
  settings.c_cc[VTIME] = 0;
  if (tcsetattr(open.handle, TCSANOW, &settings) != 0) {
    return failed("cannot be set up", std::strerror(errno));
  }
  code = sp_flush(open.port, SP_BUF_INPUT);
  if (code != SP_OK) return failed("cannot be emptied", serial_error(code));
  return Unit{};
}

}  // namespace

using SteadyTime = std::chrono::steady_clock;

struct SerialPort::Impl : std::enable_shared_from_this<Impl> {
  Impl(asio::io_context& context, Handlers called)
      : io(context), handlers(std::move(called)), pace(context) {}

  asio::io_context& io;
  Handlers handlers;
  // The descriptor only borrows the handle: libserialport closes it.
  std::optional<asio::posix::stream_descriptor> descriptor;
  std::unique_ptr<OpenPort> open;
  std::uint64_t opening = 0;  // handlers of an earlier opening find that it is no longer theirs
  std::string unsent;
  std::size_t urgent = 0;  // so many bytes at the front of unsent are urgent
  bool waiting_to_write = false;
  asio::steady_timer pace;
  bool waiting_for_line = false;
  SteadyTime::duration byte_time{};    // on the line; 0: not paced
  SteadyTime::time_point line_free{};  // when it will have carried all that was written
  std::uint64_t read = 0;
  std::uint64_t written = 0;

  void close() {
    if (!open) return;
    ++opening;
    descriptor->release();
    descriptor.reset();
    open.reset();
    discard();
    waiting_to_write = waiting_for_line = false;
    pace.cancel();
  }

  void discard() {
    unsent.clear();
    urgent = 0;
  }

  void lost(std::string sentence) {
    close();
    asio::post(io, [self = shared_from_this(), text = std::move(sentence)] {
      if (self->handlers.on_lost) self->handlers.on_lost(text);
    });
  }

  void wait_to_read() {
    descriptor->async_wait(asio::posix::stream_descriptor::wait_read,
                           [self = shared_from_this(), mine = opening](const error_code& failed) {
                             if (!failed && self->opening == mine) self->read_some();
                           });
  }

  void read_some() {
    std::array<char, 4096> buffer;
    const sp_return count = sp_nonblocking_read(open->port, buffer.data(), buffer.size());
    if (count > 0) {
      read += static_cast<std::uint64_t>(count);
      const std::uint64_t mine = opening;
      handlers.on_bytes(std::string_view(buffer.data(), static_cast<std::size_t>(count)));
      if (opening != mine) return;  // the port was closed by what the bytes said
    } else {
      // Ready to be read, and nothing there: the other end has gone, unless somebody was quicker.
      pollfd state{open->handle, POLLIN, 0};
      if (count < 0 || poll(&state, 1, 0) < 0 || (state.revents & (POLLHUP | POLLERR | POLLNVAL))) {
        lost("The device has gone: the port hung up.");
        return;
      }
    }
    wait_to_read();
  }

  // False: the port was lost.
  bool write_some() {
    while (!unsent.empty()) {
      const std::size_t allowed = std::min(unsent.size(), std::max(urgent, room_in_kernel()));
      if (allowed == 0) {
        wait_for_line();
        return true;
      }
      const ssize_t count = ::write(open->handle, unsent.data(), allowed);
      if (count > 0) {
        line_free = std::max(line_free, SteadyTime::now()) + count * byte_time;
        written += static_cast<std::uint64_t>(count);
        unsent.erase(0, static_cast<std::size_t>(count));
        urgent -= std::min(urgent, static_cast<std::size_t>(count));
      } else if (errno == EAGAIN) {
        wait_to_write();
        return true;
      } else if (errno != EINTR) {
        lost(std::string("The device has gone: ") + std::strerror(errno) + ".");
        return false;
      }
    }
    return true;
  }

  // How far the line may be behind what was written.
  SteadyTime::duration ahead_max() const {
    return std::max<SteadyTime::duration>(kKernelBytes * byte_time, kAheadMax);
  }

  std::size_t room_in_kernel() const {
    if (byte_time == SteadyTime::duration::zero()) return unsent.size();
    const auto room = ahead_max() - (line_free - SteadyTime::now());
    return room < byte_time ? 0 : static_cast<std::size_t>(room / byte_time);
  }

  // Until half of what may stand in the kernel has gone.
  void wait_for_line() {
    if (waiting_for_line) return;
    waiting_for_line = true;
    pace.expires_at(line_free - ahead_max() / 2);
    pace.async_wait([self = shared_from_this(), mine = opening](const error_code& failed) {
      if (failed || self->opening != mine) return;
      self->waiting_for_line = false;
      if (self->write_some() && self->handlers.on_written) self->handlers.on_written();
    });
  }

  void wait_to_write() {
    if (waiting_to_write) return;
    waiting_to_write = true;
    descriptor->async_wait(asio::posix::stream_descriptor::wait_write,
                           [self = shared_from_this(), mine = opening](const error_code& failed) {
                             if (failed || self->opening != mine) return;
                             self->waiting_to_write = false;
                             if (self->write_some() && self->handlers.on_written) {
                               self->handlers.on_written();
                             }
                           });
  }
};

SerialPort::SerialPort(asio::io_context& io, Handlers handlers)
    : impl_(std::make_shared<Impl>(io, std::move(handlers))) {}

SerialPort::~SerialPort() {
  impl_->close();
  impl_->handlers = {};
}

Status SerialPort::open(const std::string& path, const How& how) {
  assert(!impl_->open);
  auto port = std::make_unique<OpenPort>();
  if (Status done = configure(*port, path, how); !done) return done;
  impl_->open = std::move(port);
  impl_->byte_time = how.paced ? SteadyTime::duration(std::chrono::seconds(10)) / how.baud
                               : SteadyTime::duration::zero();
  impl_->line_free = {};
  ++impl_->opening;
  impl_->descriptor.emplace(impl_->io, impl_->open->handle);
  impl_->wait_to_read();
  return Unit{};
}

void SerialPort::close() {
  impl_->close();
}

bool SerialPort::is_open() const {
  return impl_->open != nullptr;
}

int SerialPort::handle() const {
  assert(impl_->open);
  return impl_->open->handle;
}

void SerialPort::write(std::string_view bytes, bool urgent) {
  if (!impl_->open || bytes.empty()) return;
  if (impl_->unsent.size() + bytes.size() > kUnsentMax) {
    impl_->lost("The device takes no bytes any more.");
    return;
  }
  impl_->unsent.insert(urgent ? 0 : impl_->unsent.size(), bytes);
  if (urgent) impl_->urgent += bytes.size();
  impl_->write_some();
}

void SerialPort::drop_unsent() {
  impl_->discard();
}

std::uint64_t SerialPort::bytes_read() const {
  return impl_->read;
}

std::uint64_t SerialPort::bytes_written() const {
  return impl_->written;
}

void SerialPort::counted_from(std::uint64_t bytes_read) {
  impl_->read = bytes_read;
}

}  // namespace reforge
