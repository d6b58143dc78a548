#include "tools/reforge/extruder_port.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string>

#include "protocols/extruder_text.h"

namespace reforge {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kAnswer{300};
constexpr int kAttempts = 5;
constexpr milliseconds kBoot{2500};  // boot loader included
constexpr milliseconds kBeat{150};

Error device_error(const std::string& sentence) {
  return Error{Code::kDevice, sentence};
}

bool configure(int fd) {
  termios settings{};
  if (tcgetattr(fd, &settings) != 0) return false;
  cfmakeraw(&settings);
  settings.c_cflag |= CLOCAL | CREAD;
  settings.c_cflag &= ~static_cast<tcflag_t>(HUPCL | CSTOPB | CRTSCTS);
  settings.c_cc[VMIN] = 1;
  settings.c_cc[VTIME] = 0;
  cfsetispeed(&settings, B115200);
  cfsetospeed(&settings, B115200);
  return tcsetattr(fd, TCSANOW, &settings) == 0;
}

}  // namespace

ExtruderPort::ExtruderPort(ExtruderPort&& other) noexcept
    : fd_(std::exchange(other.fd_, -1)),
      decoder_(other.decoder_),
      inbox_(std::move(other.inbox_)),
      banner_(other.banner_),
      sequence_(other.sequence_),
      question_(other.question_),
      next_beat_(other.next_beat_),
      beating_(other.beating_) {}

ExtruderPort::~ExtruderPort() {
  if (fd_ >= 0) ::close(fd_);
}

Result<ExtruderPort> ExtruderPort::open(const std::filesystem::path& port) {
  const int fd = ::open(port.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0 && errno != EBUSY) {
    return device_error("The port " + port.string() + " cannot be opened: " + std::strerror(errno) +
                        ".");
  }
  ExtruderPort opened(fd);
  if (fd < 0 || ::flock(fd, LOCK_EX | LOCK_NB) != 0) {
    return device_error("The port " + port.string() +
                        " is held by another program, the daemon perhaps: stop it first "
                        "(systemctl stop reforged).");
  }
  if (!configure(fd) || ::ioctl(fd, TIOCEXCL) != 0) {
    return device_error(port.string() + " is no serial port: " + std::strerror(errno) + ".");
  }
  if (const Status greeted = opened.greet(); !greeted) return greeted.error();
  return opened;
}

// A board that was just reset says so within its boot time; one that was not says nothing.
Status ExtruderPort::greet() {
  const auto session = static_cast<std::uint16_t>(1 + Clock::now().time_since_epoch() /
                                                          std::chrono::milliseconds(1) % 65'000);
  const auto give_up = Clock::now() + kBoot;
  while (true) {
    if (const Status sent = send(pack(wire::Hello{wire::kProtocolVersion, session}, 0)); !sent) {
      return sent.error();
    }
    const auto until = Clock::now() + kAnswer;
    while (Clock::now() < until) {
      const auto frame = await(wire::Type::kBanner, kAnswer);
      if (!frame) return frame.error();
      if (*frame && unpack(**frame, banner_) && banner_.session == session) {
        beating_ = true;
        return Unit{};
      }
    }
    if (Clock::now() > give_up) {
      return device_error(
          "Nobody answers on this port: is it the extruder board, with its firmware "
          "(tools/reforge-flash) and power?");
    }
  }
}

Status ExtruderPort::send(const wire::Frame& frame) {
  uint8_t bytes[wire::kFrameMax];
  const uint8_t count = encode(frame, bytes);
  for (uint8_t sent = 0; sent < count;) {
    const ssize_t n = ::write(fd_, bytes + sent, static_cast<size_t>(count - sent));
    if (n > 0) {
      sent = static_cast<uint8_t>(sent + n);
    } else if (errno == EAGAIN || errno == EINTR) {
      pollfd ready{fd_, POLLOUT, 0};
      ::poll(&ready, 1, 100);
    } else {
      return device_error(std::string("The extruder's port is gone: ") + std::strerror(errno) +
                          ".");
    }
  }
  next_beat_ = Clock::now() + kBeat;
  return Unit{};
}

Result<std::optional<wire::Frame>> ExtruderPort::await(wire::Type type, Milliseconds within,
                                                       std::optional<wire::Type> or_type) {
  const auto end = Clock::now() + within;
  while (true) {
    while (!inbox_.empty()) {
      const wire::Frame frame = inbox_.front();
      inbox_.pop_front();
      wire::FaultReport fault{};
      if (frame.type == type || frame.type == or_type) return std::optional(frame);
      if (unpack(frame, fault)) return device_error(std::string(sentence_of(fault.fault)));
    }
    const auto now = Clock::now();
    if (now >= end) return std::optional<wire::Frame>();
    if (beating_ && now >= next_beat_) {
      if (const Status sent = send(wire::pack(wire::Type::kHeartbeat, 0)); !sent) {
        return sent.error();
      }
    }
    const auto wake = beating_ ? std::min(end, next_beat_) : end;
    const auto wait = std::chrono::ceil<milliseconds>(wake - now).count();
    if (const Status read = read_some(static_cast<int>(std::max<long>(0, wait))); !read) {
      return read.error();
    }
  }
}

Status ExtruderPort::read_some(int within_ms) {
  pollfd ready{fd_, POLLIN, 0};
  if (::poll(&ready, 1, within_ms) <= 0) return Unit{};
  uint8_t bytes[256];
  const ssize_t n = ::read(fd_, bytes, sizeof bytes);
  if (n < 0 && (errno == EAGAIN || errno == EINTR)) return Unit{};
  if (n <= 0) return device_error("The extruder's port is gone.");
  wire::Frame frame;
  for (ssize_t i = 0; i < n; ++i) {
    decoder_.push(bytes[i]);
    while (decoder_.take(frame)) inbox_.push_back(frame);
  }
  return Unit{};
}

Status ExtruderPort::order(const wire::Frame& order, Milliseconds within) {
  wire::Frame frame = order;
  frame.sequence = ++sequence_;
  const auto end = Clock::now() + within;
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    if (const Status sent = send(frame); !sent) return sent.error();
    const auto ack_end = Clock::now() + kAnswer;
    bool accepted = false;
    while (Clock::now() < (accepted ? end : ack_end)) {
      const auto left = std::chrono::ceil<milliseconds>((accepted ? end : ack_end) - Clock::now());
      const auto answer = await(wire::Type::kDone, left, wire::Type::kAck);
      if (!answer) return answer.error();
      if (!*answer || (*answer)->sequence != sequence_) continue;
      wire::Ack ack{};
      wire::Done done{};
      if (unpack(**answer, ack)) {
        if (ack.reason != wire::Reason::kNone) {
          return Error{Code::kRefused, std::string(sentence_of(ack.reason))};
        }
        accepted = true;
      } else if (unpack(**answer, done)) {
        if (done.reason == wire::Reason::kNone) return Unit{};
        return Error{Code::kRefused, std::string(sentence_of(done.reason))};
      }
    }
    if (accepted) return device_error("The extruder has not come to an end in time.");
  }
  return device_error("The extruder does not acknowledge.");
}

Status ExtruderPort::m_code(int code, std::int32_t argument, Milliseconds within) {
  return order(pack(wire::Command{static_cast<uint8_t>(code), argument}, 0), within);
}

Result<wire::Status> ExtruderPort::status() {
  wire::Status status{};
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    const std::uint8_t question = ++question_;
    if (const Status sent = send(wire::pack(wire::Type::kStatusQuery, question)); !sent) {
      return sent.error();
    }
    const auto frame = await(wire::Type::kStatus, kAnswer);
    if (!frame) return frame.error();
    if (*frame && unpack(**frame, status)) return status;
  }
  return device_error("The extruder does not answer.");
}

Result<std::int32_t> ExtruderPort::setting(wire::Setting id) {
  wire::SettingValue value{};
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    if (const Status sent = send(pack(wire::GetSetting{id}, ++question_)); !sent) {
      return sent.error();
    }
    const auto frame = await(wire::Type::kSettingValue, kAnswer);
    if (!frame) return frame.error();
    if (*frame && unpack(**frame, value) && value.id == id) return value.value;
  }
  return device_error("The extruder does not answer.");
}

Status ExtruderPort::keep(Milliseconds time) {
  const auto end = Clock::now() + time;
  while (Clock::now() < end) {
    const auto left = std::chrono::ceil<milliseconds>(end - Clock::now());
    const auto frame = await(wire::Type::kFault, left);
    if (!frame) return frame.error();
    wire::FaultReport fault{};
    if (*frame && unpack(**frame, fault))
      return device_error(std::string(sentence_of(fault.fault)));
  }
  return Unit{};
}

}  // namespace reforge
