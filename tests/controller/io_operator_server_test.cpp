#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <sys/un.h>
#include <unistd.h>

#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <cstring>
#include <future>
#include <thread>

#include "controller/io/operator_server.h"
#include "tests/rig/scratch_folder.h"

namespace reforge {
namespace {

using nlohmann::json;

// A client that only knows lines. Reading gives up after some seconds: no test hangs.
class Client {
 public:
  explicit Client(const std::string& path) : handle_(::socket(AF_UNIX, SOCK_STREAM, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::strncpy(address.sun_path, path.c_str(), sizeof address.sun_path - 1);
    const timeval patience{10, 0};
    setsockopt(handle_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    setsockopt(handle_, SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
    EXPECT_EQ(::connect(handle_, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  }
  ~Client() { ::close(handle_); }
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  void say(const std::string& bytes) {
    std::size_t at = 0;
    while (at < bytes.size()) {
      const ssize_t n = ::send(handle_, bytes.data() + at, bytes.size() - at, MSG_NOSIGNAL);
      if (n <= 0) return;
      at += static_cast<std::size_t>(n);
    }
  }
  // The next line; nothing at the end of the connection.
  std::optional<json> hear() {
    while (received_.find('\n') == std::string::npos) {
      char buffer[65536];
      const ssize_t n = ::read(handle_, buffer, sizeof buffer);
      if (n <= 0) return std::nullopt;
      received_.append(buffer, static_cast<std::size_t>(n));
    }
    const std::size_t end = received_.find('\n');
    json message = json::parse(received_.substr(0, end), nullptr, false);
    received_.erase(0, end + 1);
    return message;
  }
  json call(const std::string& method, const json& params = json::object()) {
    say(json({{"jsonrpc", "2.0"}, {"id", ++calls_}, {"method", method}, {"params", params}})
            .dump() +
        "\n");
    return hear().value_or(json());
  }
  json hello() { return call("hello", {{"version", 1}}); }

 private:
  int handle_;
  int calls_ = 0;
  std::string received_;
};

int code_of(const json& answer) {
  return answer.value("error", json::object()).value("code", 0);
}

// The server in a thread of its own, answering every call with its method's name.
class OperatorDoor : public ::testing::Test {
 protected:
  void open(RoleOf role_of, std::size_t clients_max = 200) {
    auto made = OperatorServer::listen(
        io_, {path_, clients_max, std::move(role_of), json{{"daemon", "test"}}},
        [this](const Call& call) {
          ++calls_;
          call.answer(json{{"did", api::name_of(call.method)}, {"who", call.peer.who}});
        });
    ASSERT_TRUE(made.ok()) << made.error().sentence;
    server_ = std::move(*made);
    thread_ = std::thread([this] { io_.run(); });
  }
  void open_for(api::Role role) {
    open([role](uid_t, const std::vector<gid_t>&) { return role; });
  }
  void TearDown() override {
    if (!thread_.joinable()) return;
    in_loop([this] { server_.reset(); });
    io_.stop();
    thread_.join();
  }
  template <typename Work>
  void in_loop(Work work) {
    std::promise<void> done;
    boost::asio::post(io_, [&] {
      work();
      done.set_value();
    });
    done.get_future().get();
  }

  ScratchFolder scratch_;
  std::string path_ = (scratch_.path / "door.sock").string();
  boost::asio::io_context io_;
  std::unique_ptr<OperatorServer> server_;
  std::thread thread_;
  std::atomic<int> calls_{0};
};

TEST_F(OperatorDoor, HelloComesFirst) {
  open_for(api::Role::kOperate);
  Client client(path_);
  EXPECT_EQ(code_of(client.call("status")), static_cast<int>(Code::kNotAllowed));
  const json hello = client.hello();
  EXPECT_EQ(hello["result"]["role"], "operate");
  EXPECT_EQ(hello["result"]["daemon"], "test");
  EXPECT_EQ(client.call("status")["result"]["did"], "status");
  EXPECT_EQ(calls_, 1);
}

TEST_F(OperatorDoor, OtherVersionIsRefused) {
  open_for(api::Role::kOperate);
  Client client(path_);
  EXPECT_EQ(code_of(client.call("hello", {{"version", 2}})), static_cast<int>(Code::kWrongVersion));
  EXPECT_EQ(code_of(client.call("hello")), api::kInvalidParams);
}

TEST_F(OperatorDoor, SocketIsForItsGroupOnly) {
  open_for(api::Role::kOperate);
  struct stat about {};
  ASSERT_EQ(::stat(path_.c_str(), &about), 0);
  EXPECT_EQ(about.st_mode & 0777u, 0660u);
}

TEST_F(OperatorDoor, RoleLimitsWhatMayBeCalled) {
  open_for(api::Role::kObserve);
  Client client(path_);
  const json methods = client.hello()["result"]["methods"];
  EXPECT_EQ(methods, (json{"hello", "status", "jobs", "subscribe"}));
  for (const char* method :
       {"submit", "start", "hold", "resume", "abort", "emergency", "clear", "shutdown"}) {
    EXPECT_EQ(code_of(client.call(method)), static_cast<int>(Code::kNotAllowed)) << method;
  }
  EXPECT_EQ(calls_, 0);
  EXPECT_EQ(client.call("jobs")["result"]["did"], "jobs");
}

TEST_F(OperatorDoor, PeerWithoutARoleIsTurnedAway) {
  open([](uid_t user, const std::vector<gid_t>& groups) -> std::optional<api::Role> {
    EXPECT_EQ(user, ::getuid());
    EXPECT_FALSE(groups.empty());
    return std::nullopt;
  });
  Client client(path_);
  EXPECT_EQ(code_of(client.hear().value_or(json())), static_cast<int>(Code::kNotAllowed));
  EXPECT_EQ(client.hear(), std::nullopt);
}

TEST_F(OperatorDoor, MalformedLinesHarmNobody) {
  open_for(api::Role::kOperate);
  Client other(path_);
  other.hello();
  Client client(path_);
  client.hello();
  for (const std::string& line :
       {std::string(), std::string("garbage"), std::string("\0\xff\xfe", 3), std::string("[1,2]"),
        std::string("{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"nonsense\"}"),
        std::string(60000, '[')}) {
    client.say(line + "\n");
    EXPECT_LT(code_of(client.hear().value_or(json())), 0);
  }
  EXPECT_EQ(client.call("status")["result"]["did"], "status");
  EXPECT_EQ(other.call("status")["result"]["did"], "status");
}

TEST_F(OperatorDoor, LineBeyondTheBoundIsToldAndDisconnected) {
  open_for(api::Role::kOperate);
  Client client(path_);
  client.hello();
  client.say(std::string(api::kLineMax + 1, 'x'));
  EXPECT_EQ(code_of(client.hear().value_or(json())), api::kInvalidRequest);
  EXPECT_EQ(client.hear(), std::nullopt);
  Client other(path_);
  EXPECT_EQ(other.hello()["result"]["version"], 1);
}

TEST_F(OperatorDoor, RequestWithoutIdIsObeyedInSilence) {
  open_for(api::Role::kOperate);
  Client client(path_);
  client.hello();
  client.say("{\"jsonrpc\":\"2.0\",\"method\":\"hold\"}\n");
  EXPECT_EQ(client.call("status")["result"]["did"], "status");
  EXPECT_EQ(calls_, 2);
}

TEST_F(OperatorDoor, RequestsInOnePieceAreAnsweredInOrder) {
  open_for(api::Role::kOperate);
  Client client(path_);
  client.hello();
  std::string many;
  for (int i = 100; i < 600; ++i) {
    many += json({{"jsonrpc", "2.0"}, {"id", i}, {"method", "status"}}).dump() + "\n";
  }
  client.say(many);
  for (int i = 100; i < 600; ++i) EXPECT_EQ(client.hear().value_or(json())["id"], i);
}

TEST_F(OperatorDoor, SlowSubscriberMissesProgressOnly) {
  open_for(api::Role::kObserve);
  Client slow(path_);
  slow.hello();
  EXPECT_EQ(slow.call("subscribe")["result"]["subscribed"], true);
  const json padding(std::string(1000, 'p'));
  in_loop([&] {
    for (int i = 0; i < 2000; ++i) {
      server_->publish("progress", {{"i", i}, {"padding", padding}},
                       OperatorServer::Kind::kMayDrop);
      if (i % 100 == 0) server_->publish("job", {{"i", i}}, OperatorServer::Kind::kMustArrive);
    }
    server_->publish("end", json::object(), OperatorServer::Kind::kMustArrive);
  });
  int progress = 0, jobs = 0;
  while (auto note = slow.hear()) {
    if ((*note)["method"] == "progress") ++progress;
    if ((*note)["method"] == "job") {
      EXPECT_EQ((*note)["params"]["i"], 100 * jobs++);
    }
    if ((*note)["method"] == "end") break;
  }
  EXPECT_EQ(jobs, 20);
  EXPECT_LT(progress, 2000);
  EXPECT_GT(progress, 0);
}

TEST_F(OperatorDoor, SubscriberThatNeverReadsIsDisconnectedAndOthersAreNot) {
  open_for(api::Role::kObserve);
  Client deaf(path_), other(path_);
  deaf.hello();
  deaf.call("subscribe");
  other.hello();
  const json padding(std::string(10000, 'p'));
  std::size_t left = 1;
  for (int i = 0; i < 400 && left > 0; ++i) {
    in_loop([&] {
      server_->publish("job", {{"padding", padding}}, OperatorServer::Kind::kMustArrive);
      left = server_->subscribers();
    });
  }
  EXPECT_EQ(left, 0u);
  EXPECT_EQ(other.call("status")["result"]["did"], "status");
}

TEST_F(OperatorDoor, OnlySubscribersAreNotified) {
  open_for(api::Role::kObserve);
  Client client(path_);
  client.hello();
  in_loop([&] { server_->publish("job", json::object(), OperatorServer::Kind::kMustArrive); });
  EXPECT_EQ(client.call("status")["result"]["did"], "status");
}

TEST_F(OperatorDoor, ManyClientsAreServedAndOneTooManyIsTold) {
  open([](uid_t, const std::vector<gid_t>&) { return api::Role::kObserve; }, 50);
  std::vector<std::unique_ptr<Client>> clients;
  for (int i = 0; i < 50; ++i) {
    clients.push_back(std::make_unique<Client>(path_));
    EXPECT_EQ(clients.back()->hello()["result"]["role"], "observe");
  }
  {
    Client surplus(path_);
    EXPECT_EQ(code_of(surplus.hear().value_or(json())), static_cast<int>(Code::kBusy));
  }
  for (const auto& client : clients) {
    EXPECT_EQ(client->call("status")["result"]["did"], "status");
  }
}

TEST_F(OperatorDoor, SecondDaemonIsRefusedAndADeadOnesSocketReplaced) {
  open_for(api::Role::kObserve);
  boost::asio::io_context other;
  const auto second = OperatorServer::listen(other, {path_, 1, {}, json::object()}, [](Call) {});
  ASSERT_FALSE(second.ok());
  EXPECT_EQ(second.error().code, Code::kBusy);

  // What kill -9 leaves behind: a socket file nobody listens on.
  const std::string dead = (scratch_.path / "dead.sock").string();
  const int handle = ::socket(AF_UNIX, SOCK_STREAM, 0);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strncpy(address.sun_path, dead.c_str(), sizeof address.sun_path - 1);
  ASSERT_EQ(::bind(handle, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  ::close(handle);
  EXPECT_TRUE(OperatorServer::listen(other, {dead, 1, {}, json::object()}, [](Call) {}).ok());
}

}  // namespace
}  // namespace reforge
