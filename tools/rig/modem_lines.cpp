#include "tools/rig/modem_lines.h"

#include <sys/socket.h>

#include <array>
#include <cerrno>
#include <string_view>

namespace reforge {

Result<ModemLines> ModemLines::listen(const std::filesystem::path& file) {
  auto listener = UnixListener::listen(file, SOCK_SEQPACKET);
  if (!listener) return listener.error();
  return ModemLines(std::move(*listener));
}

std::vector<ModemEvent> ModemLines::take() {
  while (FileHandle connection = listener_.accept()) {
    programs_.push_back({std::move(connection), {}});
  }
  std::vector<ModemEvent> events;
  std::erase_if(programs_, [&](Program& program) { return !drain(program, events); });
  return events;
}

// False when the program has closed the port.
bool ModemLines::drain(Program& program, std::vector<ModemEvent>& events) {
  constexpr std::string_view kOpen = "open ";
  using Kind = ModemEvent::Kind;
  std::array<char, 64> buffer;
  while (true) {
    const ssize_t n = ::recv(program.connection.get(), buffer.data(), buffer.size(), 0);
    if (n < 0 && (errno == EAGAIN || errno == EINTR)) return true;
    if (n <= 0) {
      if (!program.device.empty()) events.push_back({program.device, Kind::kClosed});
      return false;
    }
    const std::string_view message(buffer.data(), static_cast<size_t>(n));
    if (message.starts_with(kOpen) && program.device.empty()) {
      program.device = message.substr(kOpen.size());
      events.push_back({program.device, Kind::kOpened});
    } else if (message == "dtr 1" && !program.device.empty()) {
      events.push_back({program.device, Kind::kDtrHigh});
    } else if (message == "dtr 0" && !program.device.empty()) {
      events.push_back({program.device, Kind::kDtrLow});
    }
  }
}

std::vector<int> ModemLines::fds() const {
  std::vector<int> fds{listener_.fd()};
  for (const Program& program : programs_) fds.push_back(program.connection.get());
  return fds;
}

}  // namespace reforge
