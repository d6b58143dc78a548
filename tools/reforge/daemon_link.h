// The command line's end of the operator socket (FORMATS.md): calls that wait for their answer, and
// the notifications that came meanwhile.
#pragma once

#include <deque>
#include <nlohmann/json.hpp>
#include <string>

#include "protocols/operator_api.h"
#include "protocols/result.h"

namespace reforge {

struct Notification {
  std::string method;
  nlohmann::json params;
};

class DaemonLink {
 public:
  // Connects and says hello.
  static Result<DaemonLink> connect(const std::string& socket);
  DaemonLink(DaemonLink&& other) noexcept;
  DaemonLink& operator=(DaemonLink&&) = delete;
  ~DaemonLink();

  // The result, or the daemon's refusal with its own code and sentence.
  Result<nlohmann::json> call(api::Method method, const nlohmann::json& params);
  // Waits for the next one; an error once the daemon has gone.
  Result<Notification> next();

 private:
  explicit DaemonLink(int handle) : handle_(handle) {}
  Status send(const std::string& line);
  Result<nlohmann::json> receive();

  int handle_;
  std::int64_t calls_ = 0;
  std::string received_;
  std::deque<Notification> waiting_;
};

}  // namespace reforge
