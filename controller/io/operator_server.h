// The daemon's door: a Unix socket, newline-delimited JSON-RPC 2.0 (protocols/operator_api.h).
//
// Keeps to itself what concerns every client alike: framing and its bounds, the hello that must
// come first, who the peer is (SO_PEERCRED and SO_PEERGROUPS) and what that allows, subscriptions,
// and slow readers. What is well formed and allowed goes to on_call, and only that.
//
// Bounds, per client: a line of api::kLineMax (longer: told, then disconnected); kCallsMax calls
// not yet answered, then nothing more is read from it; kProgressMax messages waiting, then
// notifications of progress are dropped; kOutgoingMax bytes waiting, then it is disconnected.
// Others never notice. Lives in the io_context's thread.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "protocols/operator_api.h"
#include "protocols/result.h"

namespace boost::asio {
class io_context;
}

namespace reforge {

struct Peer {
  std::string who;  // "anna (uid 1000, pid 4711)"
  api::Role role;
};

// Which role the peer has, from who it is; none: it is not let in.
using RoleOf = std::function<std::optional<api::Role>(uid_t, const std::vector<gid_t>&)>;

// A call's outcome: its result, or why not.
using Answer = std::variant<nlohmann::json, api::Failure>;
Answer answer_of(const Error& error);

struct Call {
  Peer peer;
  api::Method method;
  nlohmann::json params;
  std::function<void(Answer)> answer;  // once, now or later, also when the client has gone
};

class OperatorServer {
 public:
  static constexpr std::size_t kCallsMax = 16;
  static constexpr std::size_t kProgressMax = 8;
  static constexpr std::size_t kOutgoingMax = 1024 * 1024;

  struct Options {
    std::filesystem::path socket;
    std::size_t clients_max;
    RoleOf role_of;
    nlohmann::json about;                         // added to the answer to hello
    std::optional<int> listening = std::nullopt;  // a socket that systemd listens on for us
  };

  // Takes the place of a socket file nobody listens on; the new one has mode 0660.
  static Result<std::unique_ptr<OperatorServer>> listen(boost::asio::io_context& io,
                                                        Options options,
                                                        std::function<void(Call)> on_call);
  ~OperatorServer();

  // Also for those who are in: whoever has no role any more is disconnected.
  void set_policy(std::size_t clients_max, RoleOf role_of);

  // To every subscriber. Only what may be dropped is, and only for those who are slow.
  enum class Kind { kMayDrop, kMustArrive };
  void publish(const char* method, const nlohmann::json& params, Kind kind);
  std::size_t subscribers() const;

 private:
  struct Impl;
  explicit OperatorServer(std::shared_ptr<Impl> impl);
  std::shared_ptr<Impl> impl_;
};

}  // namespace reforge
