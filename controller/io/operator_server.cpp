#include "controller/io/operator_server.h"

#include <grp.h>
#include <pwd.h>
#include <spdlog/spdlog.h>
#include <sys/socket.h>
#include <sys/stat.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/local/stream_protocol.hpp>
#include <boost/asio/read_until.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/streambuf.hpp>
#include <boost/asio/write.hpp>
#include <chrono>
#include <deque>
#include <set>

namespace reforge {
namespace {

namespace asio = boost::asio;
using asio::local::stream_protocol;
using boost::system::error_code;
using nlohmann::json;

constexpr int kNotAllowed = static_cast<int>(Code::kNotAllowed);

std::vector<gid_t> groups_of(int socket, gid_t primary) {
  std::vector<gid_t> groups(1 + NGROUPS_MAX);
  auto bytes = static_cast<socklen_t>(groups.size() * sizeof(gid_t));
  if (getsockopt(socket, SOL_SOCKET, SO_PEERGROUPS, groups.data(), &bytes) != 0) bytes = 0;
  groups.resize(bytes / sizeof(gid_t));
  groups.push_back(primary);
  return groups;
}

std::string who(const ucred& peer) {
  const passwd* entry = getpwuid(peer.uid);
  return std::string(entry == nullptr ? "?" : entry->pw_name) + " (uid " +
         std::to_string(peer.uid) + ", pid " + std::to_string(peer.pid) + ")";
}

}  // namespace

Answer answer_of(const Error& error) {
  return api::Failure{static_cast<int>(error.code), error.sentence};
}

struct OperatorServer::Impl : std::enable_shared_from_this<Impl> {
  class Session;

  Impl(asio::io_context& io, Options chosen, std::function<void(Call)> called)
      : options(std::move(chosen)), on_call(std::move(called)), acceptor(io), pause(io) {}

  Options options;
  std::function<void(Call)> on_call;
  stream_protocol::acceptor acceptor;
  asio::steady_timer pause;
  std::set<std::shared_ptr<Session>> sessions;
  bool closed = false;

  void accept();
  void admit(stream_protocol::socket socket);
};

class OperatorServer::Impl::Session : public std::enable_shared_from_this<Session> {
 public:
  Session(std::shared_ptr<Impl> server, stream_protocol::socket socket, Peer peer, uid_t user,
          std::vector<gid_t> groups)
      : server_(std::move(server)),
        socket_(std::move(socket)),
        peer_(std::move(peer)),
        user_(user),
        groups_(std::move(groups)) {}

  // By the policy of now.
  void judge() {
    const auto role = server_->options.role_of(user_, groups_);
    if (role) {
      peer_.role = *role;
      return;
    }
    send(api::error_response(nullptr, {kNotAllowed, peer_.who + " has no role here any more."}),
         Kind::kMustArrive);
    close_when_sent();
  }

  bool subscribed() const { return subscribed_; }

  void read() {
    if (closing_ || reading_ || unanswered_ >= kCallsMax) return;
    reading_ = true;
    asio::async_read_until(socket_, received_, '\n',
                           [self = shared_from_this()](const error_code& failed, std::size_t n) {
                             self->reading_ = false;
                             self->take(failed, n);
                           });
  }

  void send(std::string message, Kind kind) {
    if (closing_) return;
    if (kind == Kind::kMayDrop && outgoing_.size() >= kProgressMax) return;
    message.push_back('\n');
    outgoing_bytes_ += message.size();
    outgoing_.push_back(std::move(message));
    if (outgoing_bytes_ > kOutgoingMax) {
      spdlog::warn("{} does not read what it is sent and was disconnected.", peer_.who);
      close();
      return;
    }
    if (!writing_) write();
  }

  void close() {
    closing_ = true;
    error_code ignored;
    socket_.close(ignored);
    server_->sessions.erase(shared_from_this());
  }

  // After what is waiting has been sent.
  void close_when_sent() {
    last_words_ = true;
    if (!writing_) close();
  }

 private:
  void take(const error_code& failed, std::size_t bytes) {
    if (closing_ || last_words_) return;
    if (failed == asio::error::not_found) {  // the buffer is full, and no newline in it
      send(api::error_response(
               nullptr, {api::kInvalidRequest, "A message may have no more than 65536 bytes."}),
           Kind::kMustArrive);
      close_when_sent();
      return;
    }
    if (failed) {
      close();
      return;
    }
    std::string line(bytes, '\0');
    received_.sgetn(line.data(), static_cast<std::streamsize>(bytes));
    line.pop_back();
    obey(line);
    read();
  }

  void obey(const std::string& line) {
    auto parsed = api::parse_request(line);
    if (const auto* refusal = std::get_if<api::Refusal>(&parsed)) {
      send(api::error_response(refusal->id, refusal->failure), Kind::kMustArrive);
      return;
    }
    auto& request = std::get<api::Request>(parsed);
    if (auto here = answer_here(request)) {
      answer(request, *here);
      return;
    }
    ++unanswered_;
    const api::Method method = request.method;
    json params = std::move(request.params);
    server_->on_call(Call{peer_, method, std::move(params),
                          [self = shared_from_this(), request](const Answer& outcome) {
                            --self->unanswered_;
                            self->answer(request, outcome);
                            self->read();
                          }});
  }

  // What needs no daemon: greeting, refusals for lack of a greeting or of rights, subscription.
  std::optional<Answer> answer_here(const api::Request& request) {
    if (request.method == api::Method::kHello) return greet(request.params);
    if (!greeted_) {
      return api::Failure{kNotAllowed, "Say hello first: {\"version\": 1}."};
    }
    if (peer_.role < api::role_needed(request.method)) {
      return api::Failure{kNotAllowed,
                          std::string(api::name_of(request.method)) + " needs the role \"" +
                              api::name_of(api::role_needed(request.method)) + "\"; " + peer_.who +
                              " may only " + api::name_of(peer_.role) + "."};
    }
    if (request.method == api::Method::kSubscribe) {
      api::Params params(request.params);
      if (!params.fault().empty()) return api::Failure{api::kInvalidParams, params.fault()};
      subscribed_ = true;
      return Answer(json{{"subscribed", true}});
    }
    return std::nullopt;
  }

  Answer greet(const json& given) {
    api::Params params(given);
    const std::int64_t version = params.number("version", 1, 1000000);
    params.optional_text("client", 256);
    if (!params.fault().empty()) return api::Failure{api::kInvalidParams, params.fault()};
    if (version != api::kVersion) {
      return answer_of({Code::kWrongVersion,
                        "This daemon speaks version " + std::to_string(api::kVersion) + " only."});
    }
    greeted_ = true;
    json methods = json::array();
    for (int i = 0; i < api::kMethodCount; ++i) {
      const auto method = static_cast<api::Method>(i);
      if (peer_.role >= api::role_needed(method)) methods.push_back(api::name_of(method));
    }
    json result = server_->options.about;
    result["version"] = api::kVersion;
    result["role"] = api::name_of(peer_.role);
    result["methods"] = std::move(methods);
    return result;
  }

  void answer(const api::Request& request, const Answer& outcome) {
    if (!request.answered) return;
    if (const auto* failure = std::get_if<api::Failure>(&outcome)) {
      send(api::error_response(request.id, *failure), Kind::kMustArrive);
    } else {
      send(api::response(request.id, std::get<json>(outcome)), Kind::kMustArrive);
    }
  }

  void write() {
    writing_ = true;
    asio::async_write(socket_, asio::buffer(outgoing_.front()),
                      [self = shared_from_this()](const error_code& failed, std::size_t) {
                        self->wrote(failed);
                      });
  }

  void wrote(const error_code& failed) {
    writing_ = false;
    if (closing_) return;
    if (failed) {
      close();
      return;
    }
    outgoing_bytes_ -= outgoing_.front().size();
    outgoing_.pop_front();
    if (!outgoing_.empty()) {
      write();
    } else if (last_words_) {
      close();
    }
  }

  std::shared_ptr<Impl> server_;
  stream_protocol::socket socket_;
  Peer peer_;
  uid_t user_;
  std::vector<gid_t> groups_;
  asio::streambuf received_{api::kLineMax};
  std::deque<std::string> outgoing_;
  std::size_t outgoing_bytes_ = 0;
  std::size_t unanswered_ = 0;
  bool greeted_ = false;
  bool subscribed_ = false;
  bool reading_ = false;
  bool writing_ = false;
  bool last_words_ = false;
  bool closing_ = false;
};

void OperatorServer::Impl::accept() {
  acceptor.async_accept(
      [self = shared_from_this()](const error_code& failed, stream_protocol::socket socket) {
        if (self->closed || failed == asio::error::operation_aborted) return;
        if (failed) {
          // Out of descriptors, most likely: those who are inside stay served.
          spdlog::error("A client could not be let in: {}.", failed.message());
        } else {
          self->admit(std::move(socket));
        }
        self->accept();
      });
}

void OperatorServer::Impl::admit(stream_protocol::socket socket) {
  ucred credentials{};
  socklen_t bytes = sizeof credentials;
  if (getsockopt(socket.native_handle(), SOL_SOCKET, SO_PEERCRED, &credentials, &bytes) != 0) {
    return;
  }
  const std::vector<gid_t> groups = groups_of(socket.native_handle(), credentials.gid);
  const auto role = options.role_of(credentials.uid, groups);
  const bool full = sessions.size() >= options.clients_max;
  auto session = std::make_shared<Session>(
      shared_from_this(), std::move(socket),
      Peer{who(credentials), role.value_or(api::Role::kObserve)}, credentials.uid, groups);
  sessions.insert(session);
  if (full || !role) {
    const auto failure = full ? api::Failure{static_cast<int>(Code::kBusy),
                                             "The daemon has all the clients it takes."}
                              : api::Failure{kNotAllowed, who(credentials) + " has no role here."};
    session->send(api::error_response(nullptr, failure), Kind::kMustArrive);
    session->close_when_sent();
    return;
  }
  session->read();
}

Result<std::unique_ptr<OperatorServer>> OperatorServer::listen(asio::io_context& io,
                                                               Options options,
                                                               std::function<void(Call)> on_call) {
  const auto impl = std::make_shared<Impl>(io, std::move(options), std::move(on_call));
  const std::string path = impl->options.socket.string();
  const stream_protocol::endpoint endpoint(path);
  error_code failed;
  if (const auto listening = impl->options.listening) {
    impl->acceptor.assign(stream_protocol(), *listening, failed);
    if (failed) {
      return Error{Code::kUnreadable,
                   "The socket given by systemd cannot be used: " + failed.message() + "."};
    }
    impl->accept();
    return std::unique_ptr<OperatorServer>(new OperatorServer(impl));
  }
  stream_protocol::socket probe(io);
  probe.connect(endpoint, failed);
  if (!failed) return Error{Code::kBusy, path + ": another daemon listens there."};
  if (failed == asio::error::connection_refused) ::unlink(path.c_str());

  impl->acceptor.open(endpoint.protocol(), failed);
  if (!failed) {
    const mode_t before = ::umask(0117);  // 0660 from the first moment on
    impl->acceptor.bind(endpoint, failed);
    ::umask(before);
  }
  if (!failed) impl->acceptor.listen(asio::socket_base::max_listen_connections, failed);
  if (failed) {
    return Error{Code::kUnreadable,
                 path + ": the socket cannot be made: " + failed.message() + "."};
  }
  impl->accept();
  return std::unique_ptr<OperatorServer>(new OperatorServer(impl));
}

OperatorServer::OperatorServer(std::shared_ptr<Impl> impl) : impl_(std::move(impl)) {}

OperatorServer::~OperatorServer() {
  impl_->closed = true;
  error_code ignored;
  impl_->pause.cancel(ignored);
  impl_->acceptor.close(ignored);
  if (!impl_->options.listening) ::unlink(impl_->options.socket.c_str());
  while (!impl_->sessions.empty()) {
    const std::shared_ptr<Impl::Session> session = *impl_->sessions.begin();
    session->close();
  }
}

void OperatorServer::set_policy(std::size_t clients_max, RoleOf role_of) {
  impl_->options.clients_max = clients_max;
  impl_->options.role_of = std::move(role_of);
  for (const auto& session : std::set(impl_->sessions)) session->judge();
}

void OperatorServer::publish(const char* method, const json& params, Kind kind) {
  if (impl_->sessions.empty()) return;
  const std::string message = api::notification(method, params);
  // A copy: sending may end a session.
  for (const auto& session : std::set(impl_->sessions)) {
    if (session->subscribed()) session->send(message, kind);
  }
}

std::size_t OperatorServer::subscribers() const {
  std::size_t count = 0;
  for (const auto& session : impl_->sessions) count += session->subscribed() ? 1 : 0;
  return count;
}

}  // namespace reforge
