#include "tools/rig/pty_port.h"

#include <fcntl.h>
#include <stdlib.h>
#include <termios.h>

#include <array>
#include <cerrno>
#include <cstring>

namespace reforge {
namespace {

bool set_raw(int slave) {
  termios settings{};
  if (tcgetattr(slave, &settings) != 0) return false;
  cfmakeraw(&settings);
  settings.c_cflag |= HUPCL;  // what the kernel gives a serial port
  return tcsetattr(slave, TCSANOW, &settings) == 0;
}

}  // namespace

PtyPort::PtyPort(FileHandle master, FileHandle slave, std::string device,
                 std::filesystem::path link)
    : master_(std::move(master)),
      slave_(std::move(slave)),
      device_(std::move(device)),
      link_(std::move(link)) {}

PtyPort::PtyPort(PtyPort&& other) noexcept
    : master_(std::move(other.master_)),
      slave_(std::move(other.slave_)),
      device_(std::move(other.device_)),
      link_(std::exchange(other.link_, {})) {}

PtyPort::~PtyPort() {
  std::error_code ignored;
  if (!link_.empty()) std::filesystem::remove(link_, ignored);
}

Result<PtyPort> PtyPort::create(const std::filesystem::path& link) {
  const auto failed = [&] {
    return Error{Code::kDevice,
                 "No pseudo-terminal for " + link.string() + ": " + std::strerror(errno)};
  };
  FileHandle master(posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
  std::array<char, 64> name{};
  if (!master || grantpt(master.get()) != 0 || unlockpt(master.get()) != 0 ||
      ptsname_r(master.get(), name.data(), name.size()) != 0) {
    return failed();
  }
  FileHandle slave(::open(name.data(), O_RDWR | O_NOCTTY | O_CLOEXEC));
  if (!slave || !set_raw(slave.get())) return failed();
  std::error_code error;
  if (std::filesystem::is_symlink(link, error)) std::filesystem::remove(link, error);
  std::filesystem::create_symlink(name.data(), link, error);
  if (error) {
    return Error{Code::kUnreadable,
                 "The link " + link.string() + " cannot be made: " + error.message()};
  }
  return PtyPort(std::move(master), std::move(slave), name.data(), link);
}

void PtyPort::unplug() {
  std::error_code ignored;
  std::filesystem::remove(link_, ignored);
  master_ = FileHandle();
  slave_ = FileHandle();
}

Result<bool> PtyPort::plug() {
  auto made = create(link_);
  if (!made) return made.error();
  master_ = std::move(made->master_);
  slave_ = std::move(made->slave_);
  device_ = std::move(made->device_);
  made->link_.clear();  // ours now
  return true;
}

std::string PtyPort::read() {
  std::string bytes;
  std::array<char, 4096> chunk;
  while (true) {
    const ssize_t n = ::read(master_.get(), chunk.data(), chunk.size());
    if (n <= 0) return bytes;
    bytes.append(chunk.data(), static_cast<size_t>(n));
  }
}

size_t PtyPort::write(std::string_view bytes) {
  size_t taken = 0;
  while (taken < bytes.size()) {
    const ssize_t n = ::write(master_.get(), bytes.data() + taken, bytes.size() - taken);
    if (n <= 0) break;
    taken += static_cast<size_t>(n);
  }
  return taken;
}

bool PtyPort::drops_dtr_on_close() const {
  termios settings{};
  return tcgetattr(slave_.get(), &settings) == 0 && (settings.c_cflag & HUPCL) != 0;
}

}  // namespace reforge
