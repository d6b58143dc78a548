#include "controller/io/virtual_clock.h"

#include <boost/asio/io_context.hpp>
#include <boost/asio/local/stream_protocol.hpp>
#include <boost/asio/read_until.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/streambuf.hpp>
#include <boost/asio/write.hpp>
#include <charconv>
#include <chrono>
#include <optional>
#include <string_view>

namespace reforge {
namespace {

using boost::system::error_code;
namespace asio = boost::asio;

constexpr std::size_t kLineMax = 256;
// How long the answer to a tick waits while nothing runs: virtual time then passes at most ten
// times as fast as ours and two processes do not spend a processor each on waiting.
constexpr auto kIdlePause = std::chrono::milliseconds(1);

struct Tick {
  std::uint64_t number = 0;
  Instant now{};
  std::uint64_t cnc_out = 0;
  std::uint64_t extruder_out = 0;
};

// "T <n> <now_ns> <cnc_out> <ext_out>"
std::optional<Tick> parse_tick(std::string_view line) {
  if (!line.starts_with("T ")) return std::nullopt;
  line.remove_prefix(1);
  std::array<std::uint64_t, 4> numbers{};
  for (std::uint64_t& number : numbers) {
    if (line.empty() || line.front() != ' ') return std::nullopt;
    const auto [end, failed] = std::from_chars(line.data() + 1, line.data() + line.size(), number);
    if (failed != std::errc()) return std::nullopt;
    line.remove_prefix(static_cast<std::size_t>(end - line.data()));
  }
  if (!line.empty()) return std::nullopt;
  return Tick{numbers[0], Instant(static_cast<Instant::rep>(numbers[1])), numbers[2], numbers[3]};
}

}  // namespace

struct VirtualClock::Impl {
  explicit Impl(asio::io_context& io) : socket(io), pause(io) {}

  asio::local::stream_protocol::socket socket;
  asio::streambuf received{kLineMax};
  asio::steady_timer pause;  // wall time
  bool pausing = false;
  Hooks hooks;
  Tick tick;
  bool stands = false;  // the tick is not answered yet
  bool alive = true;

  std::optional<Tick> take_line() {
    std::istream in(&received);
    std::string line;
    std::getline(in, line);
    return parse_tick(line);
  }

  void lost(const std::string& sentence) {
    if (!alive) return;
    alive = false;
    stands = false;
    error_code ignored;
    socket.close(ignored);
    hooks.on_lost(sentence);
  }

  void send_d(Instant deadline) {
    const LinkCounts counts = hooks.counts();
    const std::string line =
        "D " + std::to_string(tick.number) + ' ' + std::to_string(deadline.count()) + ' ' +
        std::to_string(counts.cnc_in) + ' ' + std::to_string(counts.cnc_out) + ' ' +
        std::to_string(counts.extruder_in) + ' ' + std::to_string(counts.extruder_out) + '\n';
    // The rig reads while it waits for us, and a line is far smaller than the socket's buffer.
    error_code failed;
    asio::write(socket, asio::buffer(line), failed);
    if (failed) lost("The virtual rig's clock is gone: " + failed.message() + ".");
  }
};

Result<std::unique_ptr<VirtualClock>> VirtualClock::connect(asio::io_context& io,
                                                            const std::filesystem::path& socket) {
  auto impl = std::make_unique<Impl>(io);
  error_code failed;
  impl->socket.connect(asio::local::stream_protocol::endpoint(socket.string()), failed);
  if (!failed) asio::read_until(impl->socket, impl->received, '\n', failed);
  if (failed) {
    return Error{Code::kDevice, "The virtual rig's clock " + socket.string() +
                                    " cannot be followed: " + failed.message() + "."};
  }
  const auto tick = impl->take_line();
  if (!tick) {
    return Error{Code::kMalformed,
                 "What listens on " + socket.string() + " is not a virtual rig's clock."};
  }
  impl->tick = *tick;
  impl->stands = true;
  return std::unique_ptr<VirtualClock>(new VirtualClock(std::move(impl)));
}

VirtualClock::VirtualClock(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
VirtualClock::~VirtualClock() = default;

Instant VirtualClock::now() const {
  return impl_->tick.now;
}

LinkCounts VirtualClock::at_tick() const {
  return {impl_->tick.cnc_out, 0, impl_->tick.extruder_out, 0};
}

bool VirtualClock::tick_stands() const {
  return impl_->stands;
}

void VirtualClock::run(Hooks hooks) {
  impl_->hooks = std::move(hooks);
  read_next();
  progress();
}

void VirtualClock::read_next() {
  asio::async_read_until(
      impl_->socket, impl_->received, '\n', [this](const error_code& failed, std::size_t) {
        if (failed == asio::error::operation_aborted) return;
        if (failed) {
          impl_->lost("The virtual rig's clock is gone: " + failed.message() + ".");
          return;
        }
        const auto tick = impl_->take_line();
        if (!tick || impl_->stands || tick->now < impl_->tick.now ||
            tick->number != impl_->tick.number + 1) {
          impl_->lost("The virtual rig's clock sent a tick that is out of order or malformed.");
          return;
        }
        impl_->tick = *tick;
        impl_->stands = true;
        read_next();
        progress();
      });
}

void VirtualClock::progress() {
  Impl& impl = *impl_;
  if (!impl.stands || impl.pausing || answering_) return;
  answering_ = true;
  if (impl.hooks.has_read(impl.tick.cnc_out, impl.tick.extruder_out)) {
    while (next_deadline() <= now()) run_due();
    if (impl.stands && !impl.hooks.busy()) {
      if (impl.hooks.idle()) {
        impl.pausing = true;
        impl.pause.expires_after(kIdlePause);
        impl.pause.async_wait([this](const error_code& failed) {
          if (failed) return;
          impl_->pausing = false;
          answer();
        });
      } else {
        answer();
      }
    }
  }
  answering_ = false;
}

void VirtualClock::answer() {
  // While we paused an operator may have started something the rig has to wait for.
  if (!impl_->stands || impl_->hooks.busy()) return;
  impl_->stands = false;
  impl_->send_d(next_deadline());
}

void VirtualClock::wrote() {
  if (impl_->alive && !impl_->stands) impl_->send_d(next_deadline());
}

void VirtualClock::deadline_changed() {
  wrote();  // a deadline set while a tick stands goes out with its answer
}

}  // namespace reforge
