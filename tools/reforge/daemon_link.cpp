#include "tools/reforge/daemon_link.h"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <utility>

namespace reforge {
namespace {

using nlohmann::json;

Error lost(const std::string& why) {
  return {Code::kDevice, "The daemon has gone: " + why + "."};
}

// Codes below zero are JSON-RPC's: we asked for something that daemon does not know.
Error refusal(const json& error) {
  const int code = error.value("code", 0);
  std::string sentence = error.value("message", std::string("The daemon refused without a word."));
  if (code == api::kInvalidParams) return {Code::kUsage, std::move(sentence)};
  if (code <= 0) return {Code::kDevice, std::move(sentence)};
  return {static_cast<Code>(code), std::move(sentence)};
}

bool is_notification(const json& message) {
  const auto method = message.find("method");
  return method != message.end() && method->is_string();
}

Notification notification_of(const json& message) {
  json params = message.value("params", json::object());
  return {message.value("method", ""), params.is_object() ? std::move(params) : json::object()};
}

}  // namespace

Result<DaemonLink> DaemonLink::connect(const std::string& socket) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (socket.size() >= sizeof address.sun_path) {
    return Error{Code::kUsage, socket + ": is longer than a socket's path may be."};
  }
  std::memcpy(address.sun_path, socket.c_str(), socket.size() + 1);
  DaemonLink link(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  if (link.handle_ < 0 ||
      ::connect(link.handle_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    return Error{Code::kDevice, "No daemon at " + socket + ": " + std::strerror(errno) +
                                    ". Start it (systemctl start reforged), or name its socket in "
                                    "REFORGE_SOCKET."};
  }
  const auto hello = link.call(
      api::Method::kHello, {{"version", api::kVersion}, {"client", "reforge " REFORGE_VERSION}});
  if (!hello) return hello.error();
  return link;
}

DaemonLink::DaemonLink(DaemonLink&& other) noexcept
    : handle_(std::exchange(other.handle_, -1)),
      calls_(other.calls_),
      received_(std::move(other.received_)),
      waiting_(std::move(other.waiting_)) {}

DaemonLink::~DaemonLink() {
  if (handle_ >= 0) ::close(handle_);
}

Status DaemonLink::send(const std::string& line) {
  std::size_t at = 0;
  while (at < line.size()) {
    const ssize_t count = ::send(handle_, line.data() + at, line.size() - at, MSG_NOSIGNAL);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return lost(std::strerror(errno));
    at += static_cast<std::size_t>(count);
  }
  return Unit{};
}

Result<json> DaemonLink::receive() {
  while (true) {
    if (const std::size_t end = received_.find('\n'); end != std::string::npos) {
      json message = json::parse(received_.substr(0, end), nullptr, false);
      received_.erase(0, end + 1);
      if (!message.is_object()) return Error{Code::kMalformed, "The daemon sent no JSON object."};
      return message;
    }
    std::array<char, 65536> buffer;
    const ssize_t count = ::read(handle_, buffer.data(), buffer.size());
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return lost(std::strerror(errno));
    if (count == 0) return lost("it closed the connection");
    received_.append(buffer.data(), static_cast<std::size_t>(count));
  }
}

Result<json> DaemonLink::call(api::Method method, const json& params) {
  const std::int64_t id = ++calls_;
  const json request = {
      {"jsonrpc", "2.0"}, {"id", id}, {"method", api::name_of(method)}, {"params", params}};
  if (Status sent = send(request.dump() + "\n"); !sent) return sent.error();
  while (true) {
    const auto message = receive();
    if (!message) return message.error();
    if (is_notification(*message)) {
      waiting_.push_back(notification_of(*message));
      continue;
    }
    // An error without id concerns the connection as a whole.
    if (const auto error = message->find("error"); error != message->end() && error->is_object()) {
      return refusal(*error);
    }
    if (message->value("id", json()) == id) return message->value("result", json::object());
  }
}

Result<Notification> DaemonLink::next() {
  if (!waiting_.empty()) {
    Notification first = std::move(waiting_.front());
    waiting_.pop_front();
    return first;
  }
  while (true) {
    const auto message = receive();
    if (!message) return message.error();
    if (is_notification(*message)) return notification_of(*message);
  }
}

}  // namespace reforge
