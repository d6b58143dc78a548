#include "tools/rig/clock_link.h"

#include <sys/socket.h>

#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>

namespace reforge {
namespace {

constexpr size_t kLineMax = 256;

template <typename Number>
bool take_number(std::string_view& line, Number& number) {
  if (!line.starts_with(' ')) return false;
  line.remove_prefix(1);
  const auto [end, error] = std::from_chars(line.data(), line.data() + line.size(), number);
  if (error != std::errc{}) return false;
  line.remove_prefix(static_cast<size_t>(end - line.data()));
  return true;
}

}  // namespace

std::optional<ClockAnswer> parse_clock_answer(std::string_view line) {
  ClockAnswer answer{};
  if (!line.starts_with('D')) return std::nullopt;
  line.remove_prefix(1);
  const bool whole = take_number(line, answer.tick) && take_number(line, answer.deadline_ns) &&
                     take_number(line, answer.cnc_in) && take_number(line, answer.cnc_out) &&
                     take_number(line, answer.extruder_in) &&
                     take_number(line, answer.extruder_out) && line.empty();
  return whole ? std::optional(answer) : std::nullopt;
}

Result<ClockLink> ClockLink::listen(const std::filesystem::path& file) {
  auto listener = UnixListener::listen(file, SOCK_STREAM);
  if (!listener) return listener.error();
  return ClockLink(std::move(*listener));
}

bool ClockLink::accept() {
  if (connected()) return false;
  daemon_ = listener_.accept();
  tick_ = 0;
  received_.clear();
  why_.clear();
  return connected();
}

void ClockLink::drop() {
  daemon_ = FileHandle();
}

void ClockLink::send_tick(int64_t now_ns, uint64_t cnc_out, uint64_t extruder_out) {
  const std::string line = "T " + std::to_string(++tick_) + ' ' + std::to_string(now_ns) + ' ' +
                           std::to_string(cnc_out) + ' ' + std::to_string(extruder_out) + '\n';
  // One tick is outstanding at most, so a line always fits into the socket's buffer.
  const ssize_t n = ::send(daemon_.get(), line.data(), line.size(), MSG_NOSIGNAL);
  if (n != static_cast<ssize_t>(line.size())) {
    why_ = "it does not take ticks";
    drop();
  }
}

std::vector<ClockAnswer> ClockLink::take() {
  std::array<char, 4096> chunk;
  while (connected()) {
    const ssize_t n = ::recv(daemon_.get(), chunk.data(), chunk.size(), 0);
    if (n < 0 && (errno == EAGAIN || errno == EINTR)) break;
    if (n <= 0) {
      why_ = n == 0 ? "it closed the link" : std::strerror(errno);
      drop();
      break;
    }
    received_.append(chunk.data(), static_cast<size_t>(n));
  }
  std::vector<ClockAnswer> answers;
  size_t end;
  while ((end = received_.find('\n')) != std::string::npos) {
    const std::string line = received_.substr(0, end);
    received_.erase(0, end + 1);
    const auto answer = parse_clock_answer(line);
    if (!answer) {
      why_ = "it said \"" + line.substr(0, 60) + "\", which is no answer";
      drop();
      return answers;
    }
    answers.push_back(*answer);
  }
  if (received_.size() > kLineMax) {
    why_ = "it sent a line without end";
    drop();
  }
  return answers;
}

}  // namespace reforge
