// The daemon measured from outside: the real `reforged` on pseudo-terminals, this program being the
// CNC and the extruder board at their other ends, in real time.
//
// The CNC's UART is a model: it carries 10 bits a byte; its receiver holds as many bytes as the rig
// file says; motion takes no time. What has been read from the terminal and would not have left the
// host's UART yet is what stood in the kernel; where this program reads late, that counts too.
// Figures depend on how busy the computer is.
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <termios.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <deque>
#include <fstream>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "controller/io/simulated_extruder.h"
#include "protocols/operator_api.h"
#include "tests/rig/scratch_folder.h"
#include "tests/scenarios/process.h"
#include "tests/support/job_folder.h"
#include "tools/reforge/daemon_link.h"

namespace reforge {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using SteadyClock = std::chrono::steady_clock;

Instant now() {
  return SteadyClock::now().time_since_epoch();
}

double milliseconds(Duration d) {
  return std::chrono::duration<double, std::milli>(d).count();
}

void print_spread(const char* what, std::vector<double> ms, double wanted) {
  if (ms.empty()) {
    std::printf("%-52s nothing measured\n", what);
    return;
  }
  std::sort(ms.begin(), ms.end());
  const auto at = [&](double q) {
    return ms[std::min(ms.size() - 1,
                       static_cast<std::size_t>(q * static_cast<double>(ms.size())))];
  };
  std::printf("%-52s p50 %.3f  p99 %.3f  max %.3f ms  (%zu times; wanted p99 <= %.0f)\n", what,
              at(0.5), at(0.99), ms.back(), ms.size(), wanted);
}

class Terminal {
 public:
  Terminal() : master(posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK)) {
    char text[64] = {};
    if (master < 0 || grantpt(master) != 0 || unlockpt(master) != 0 ||
        ptsname_r(master, text, sizeof text) != 0) {
      throw std::runtime_error("no pseudo-terminal");
    }
    name = text;
    slave_ = open(text, O_RDWR | O_NOCTTY);
    termios raw{};
    tcgetattr(slave_, &raw);
    cfmakeraw(&raw);
    tcsetattr(slave_, TCSANOW, &raw);
  }
  ~Terminal() {
    ::close(slave_);
    ::close(master);
  }
  Terminal(const Terminal&) = delete;
  Terminal& operator=(const Terminal&) = delete;

  int master;
  std::string name;

 private:
  int slave_;  // kept open, or the master reads errors
};

// Both devices, in a thread of their own.
class Machine {
 public:
  Machine(int baud, int receiver)
      : byte_time_(std::chrono::duration_cast<Duration>(std::chrono::seconds(10)) / baud),
        receiver_(receiver),
        thread_([this] { run(); }) {}
  ~Machine() {
    ending_ = true;
    thread_.join();
  }

  Terminal cnc, board;

  // Read under `mutex`.
  std::mutex mutex;
  Instant last_hold{}, last_reset{};
  std::vector<double> idle_to_relay, done_to_line;
  std::int64_t carried = 0;  // bytes that the UART has carried, real-time bytes included
  std::int64_t lines = 0;
  Instant first_byte{}, last_byte{};
  double kernel_peak = 0;  // bytes that had been written and that the line had not carried yet
  int receiver_peak = 0;
  void restart_counting() {
    const std::lock_guard lock(mutex);
    carried = lines = 0;
    first_byte = last_byte = {};
    kernel_peak = 0;
    receiver_peak = 0;
    idle_to_relay.clear();
    done_to_line.clear();
  }

 private:
  struct Arriving {
    char byte;
    Instant at;
  };

  void say(Instant at, const std::string& text) {
    const Instant begins = std::max(at, spoken_until_);
    spoken_until_ = begins + static_cast<std::int64_t>(text.size()) * byte_time_;
    saying_.push_back({text, spoken_until_});
  }

  void take_from_host(Instant at) {
    char bytes[4096];
    const ssize_t count = read(cnc.master, bytes, sizeof bytes);
    if (count <= 0) return;
    if (first_byte == Instant{}) first_byte = at;
    for (ssize_t i = 0; i < count; ++i) {
      carried_until_ = std::max(carried_until_, at) + byte_time_;
      wire_.push_back({bytes[i], carried_until_});
      if (bytes[i] == '!') last_hold = at;
      if (bytes[i] == '\x18') last_reset = at;
    }
    kernel_peak = std::max(kernel_peak, static_cast<double>((carried_until_ - at).count()) /
                                            static_cast<double>(byte_time_.count()));
    const bool words = std::any_of(bytes, bytes + count, [](char c) { return c >= 'A'; });
    if (words && done_at_ != Instant{}) {
      done_to_line.push_back(milliseconds(at - done_at_));
      done_at_ = {};
    }
  }

  void take_byte(char byte, Instant at) {
    ++carried;
    last_byte = at;
    if (byte == '?') {
      const char* state = held_ ? "Hold:0" : "Idle";
      say(at, std::string("<") + state + "|MPos:0.000,0.000,0.000,0.000,0.000|FS:0,0>\r\n");
    } else if (byte == '!') {
      held_ = true;
    } else if (byte == '~') {
      held_ = false;
      parse(at);
    } else if (byte == '\x18') {
      held_ = false;
      received_.clear();
      say(at, "GrblHAL 1.1f ['$' or '$HELP' for help]\r\n");
    } else {
      received_ += byte;
      receiver_peak = std::max(receiver_peak, static_cast<int>(received_.size()));
      parse(at);
    }
  }

  void parse(Instant at) {
    while (!held_) {
      const std::size_t end = received_.find('\n');
      if (end == std::string::npos) return;
      const std::string line = received_.substr(0, end);
      received_.erase(0, end + 1);
      if (line == "$I") {
        say(at, "[VER:1.1f.20230926:]\r\n[OPT:VN,35," + std::to_string(receiver_) +
                    "]\r\n[AXS:5:XYZBC]\r\n");
      } else if (line == "$#") {
        say(at, "[G54:0.000,0.000,0.000,0.000,0.000]\r\n");
      } else {
        ++lines;
      }
      say(at, "ok\r\n");
    }
  }

  void speak(Instant at) {
    while (!saying_.empty() && saying_.front().at <= at) {
      const std::string& text = saying_.front().text;
      if (write(cnc.master, text.data(), text.size()) < 0) return;
      if (text.starts_with("<Idle")) idle_said_ = now();
      saying_.pop_front();
    }
  }

  void serve_board(Instant at) {
    char bytes[512];
    const ssize_t count = read(board.master, bytes, sizeof bytes);
    if (count > 0) {
      const std::size_t before = extruder_.executed.size();
      extruder_.receive(at, std::string_view(bytes, static_cast<std::size_t>(count)));
      if (extruder_.executed.size() > before && idle_said_ != Instant{}) {
        idle_to_relay.push_back(milliseconds(at - idle_said_));
        idle_said_ = {};
        awaits_done_ = true;
      }
    }
    const bool due = extruder_.next_event() <= at;
    extruder_.advance(at);
    const std::string said = extruder_.take_transmitted();
    if (said.empty()) return;
    if (write(board.master, said.data(), said.size()) > 0 && due && awaits_done_) {
      done_at_ = now();
      awaits_done_ = false;
    }
  }

  void run() {
    pthread_setname_np(pthread_self(), "machine");
    while (!ending_) {
      {
        const std::lock_guard lock(mutex);
        Instant at = now();
        take_from_host(at);
        while (!wire_.empty() && wire_.front().at <= at) {
          const Arriving next = wire_.front();
          wire_.pop_front();
          take_byte(next.byte, next.at);
        }
        speak(at);
        serve_board(at);
      }
      Instant next = now() + std::chrono::milliseconds(20);
      next = earlier(next, extruder_.next_event());
      // The end of a line is what matters; bytes before it need nobody awake.
      for (const Arriving& arriving : wire_) {
        if (arriving.byte >= 'A' || arriving.byte == '-' ||
            (arriving.byte >= '0' && arriving.byte <= '9')) {
          continue;
        }
        next = earlier(next, arriving.at);
        break;
      }
      if (!saying_.empty()) next = earlier(next, saying_.front().at);
      const Duration wait = std::max(next - now(), Duration::zero());
      const timespec limit{wait / std::chrono::seconds(1),
                           static_cast<long>((wait % std::chrono::seconds(1)).count())};
      pollfd ready[2] = {{cnc.master, POLLIN, 0}, {board.master, POLLIN, 0}};
      ppoll(ready, 2, &limit, nullptr);
    }
  }

  struct Saying {
    std::string text;
    Instant at;
  };
  Duration byte_time_;
  int receiver_;
  std::deque<Arriving> wire_;
  std::deque<Saying> saying_;
  Instant carried_until_{}, spoken_until_{}, idle_said_{}, done_at_{};
  bool awaits_done_ = false;
  std::string received_;
  bool held_ = false;
  SimulatedExtruder extruder_;
  std::atomic<bool> ending_{false};
  std::thread thread_;
};

// Subscribers who read what they are sent, in one thread.
class Audience {
 public:
  Audience(const std::string& socket, int count) {
    for (int i = 0; i < count; ++i) {
      const int handle = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
      sockaddr_un address{};
      address.sun_family = AF_UNIX;
      std::copy(socket.begin(), socket.end(), address.sun_path);
      if (connect(handle, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) {
        throw std::runtime_error("a subscriber is not let in");
      }
      const std::string words =
          "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"hello\",\"params\":{\"version\":1}}\n"
          "{\"jsonrpc\":\"2.0\",\"id\":2,\"method\":\"subscribe\"}\n";
      if (::send(handle, words.data(), words.size(), MSG_NOSIGNAL) < 0) {
        throw std::runtime_error("a subscriber cannot speak");
      }
      handles_.push_back({handle, POLLIN, 0});
    }
    thread_ = std::thread([this] {
      std::vector<char> bytes(65536);
      while (!ending_) {
        if (poll(handles_.data(), handles_.size(), 50) <= 0) continue;
        for (const pollfd& one : handles_) {
          if ((one.revents & POLLIN) == 0) continue;
          const ssize_t count_read = read(one.fd, bytes.data(), bytes.size());
          if (count_read > 0)
            messages_ += std::count(bytes.data(), bytes.data() + count_read, '\n');
        }
      }
    });
  }
  ~Audience() {
    ending_ = true;
    thread_.join();
    for (const pollfd& one : handles_) ::close(one.fd);
  }
  std::int64_t messages() const { return messages_; }

 private:
  std::vector<pollfd> handles_;
  std::atomic<bool> ending_{false};
  std::atomic<std::int64_t> messages_{0};
  std::thread thread_;
};

const char* const kBegin = "G21\nG90\nG94\nG17\nG54\n";

std::string milling(std::int64_t lines) {
  std::string out = kBegin;
  for (std::int64_t i = 0; i < lines; ++i) {
    char text[48];
    std::snprintf(text, sizeof text, "G1 X%.3f Y%.3f Z%.3f F1500\n",
                  static_cast<double>(i % 977) / 100, static_cast<double>(i % 1013) / 100,
                  20 + static_cast<double>(i % 7) / 1000);
    out += text;
  }
  return out + "M30\n";
}

std::string printing(int beads) {
  std::string out = std::string(kBegin) + "G0 Z100\nM70 S200\n";
  for (int i = 0; i < beads; ++i) {
    out += "G1 X" + std::to_string(i % 9) + " F500\nM72 P0.35\nG1 X1 Y" + std::to_string(i % 5) +
           "\nM73\nM74 P1\nM75\n";
  }
  return out + "G0 Z100\nM71\nM30\n";
}

class Bench {
 public:
  Bench(const fs::path& programs, int baud, int receiver) : machine_(baud, receiver) {
    json rig = json::parse(testing::read_file(testing::shipped_rig_file()));
    rig["cnc"]["baud"] = baud;
    rig["cnc"]["receive_buffer_bytes"] = receiver;
    rig_ = rig.dump();
    const fs::path here = scratch_.path;
    testing::write_file(here / "rig.json", rig_);
    const json nobody = {{"users", json::array()}, {"groups", json::array()}};
    const json config = {
        {"format", "reforged 1"},
        {"socket", socket()},
        {"state_directory", (here / "state").string()},
        {"rig", (here / "rig.json").string()},
        {"clock", "monotonic"},
        {"ports",
         {{"cnc", {{"path", machine_.cnc.name}, {"kind", "virtual"}}},
          {"extruder", {{"path", machine_.board.name}, {"kind", "virtual"}}}}},
        {"roles", {{"observe", nobody}, {"operate", nobody}, {"administer", nobody}}},
        {"verifier", {{"command", {"/bin/true"}}, {"limits", nullptr}}},
        {"limits", {{"clients", 128}, {"waiting_jobs", 16}}}};
    testing::write_file(here / "reforged.json", config.dump());
    daemon_ = std::make_unique<testing::Process>(
        std::vector<std::string>{(programs / "reforged").string(), "--config",
                                 (here / "reforged.json").string()},
        std::vector<std::string>{"LD_PRELOAD=" + (programs / "libreforge-ptyport.so").string()},
        here / "reforged.log");
    wait([&] {
      auto link = DaemonLink::connect(socket());
      if (link) link_ = std::make_unique<DaemonLink>(std::move(*link));
      return link_ != nullptr;
    });
    wait([&] { return rig_state() == "idle"; });
  }

  std::string socket() const { return (scratch_.path / "s").string(); }
  Machine& machine() { return machine_; }
  pid_t pid() const { return daemon_->id(); }

  json call(api::Method method, const json& params = json::object()) {
    auto answer = link_->call(method, params);
    if (!answer) throw std::runtime_error(answer.error().sentence);
    return *answer;
  }
  std::string rig_state() { return call(api::Method::kStatus).at("rig").at("state"); }
  api::JobReport job(std::int64_t number) {
    return *api::job_report(call(api::Method::kStatus, {{"job", number}}).at("job"));
  }
  void wait(const std::function<bool()>& holds, int seconds = 120) {
    const auto end = SteadyClock::now() + std::chrono::seconds(seconds);
    while (!holds()) {
      if (SteadyClock::now() > end) throw std::runtime_error("nothing comes: " + log());
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
  }
  std::string log() const { return testing::read_file(scratch_.path / "reforged.log"); }

  fs::path make_job(const std::string& body) {
    const fs::path folder = scratch_.path / ("job" + std::to_string(++jobs_));
    testing::make_job(folder, "M30\n");
    const std::string program =
        testing::program_header(rig_, testing::read_file(folder / "initial.stl")) + body;
    testing::write_file(folder / "program.nc", program);
    testing::write_file(folder / "rig.json", rig_);
    auto certificate = read_certificate(folder / "certificate.json");
    certificate->sha256["program"] = sha256_hex(program);
    certificate->sha256["rig"] = sha256_hex(rig_);
    testing::write_certificate(folder, *certificate);
    return folder;
  }
  std::int64_t submit(const fs::path& folder) {
    const std::int64_t number =
        call(api::Method::kSubmit, {{"path", folder.string()}}).at("job").get<std::int64_t>();
    wait([&] { return job(number).state >= api::JobState::kReady; });
    return number;
  }
  void start(std::int64_t number) {
    call(api::Method::kConfirm, {{"job", number}});
    // After an emergency the board's dead-man takes its time, and a fault has to be cleared.
    wait([&] {
      if (rig_state() == "fault") call(api::Method::kClear);
      return rig_state() == "idle" && link_->call(api::Method::kStart, {{"job", number}}).ok();
    });
  }
  void abort(std::int64_t number) {
    call(api::Method::kAbort, {{"job", number}});
    wait([&] { return is_over(job(number).state) && rig_state() == "idle"; });
  }

 private:
  ScratchFolder scratch_;
  std::string rig_;
  Machine machine_;
  std::unique_ptr<testing::Process> daemon_;
  std::unique_ptr<DaemonLink> link_;
  int jobs_ = 0;
};

void throughput(const fs::path& programs, int baud, int receiver, double wanted) {
  Bench bench(programs, baud, receiver);
  const auto job = bench.submit(bench.make_job(milling(baud / 10 * 6 / 30)));
  bench.machine().restart_counting();
  bench.start(job);
  bench.wait([&] { return is_over(bench.job(job).state); });
  Machine& m = bench.machine();
  const std::lock_guard lock(m.mutex);
  // From the first byte to the last but for the drain at the end, which waits for a status.
  const double seconds = std::chrono::duration<double>(m.last_byte - m.first_byte).count();
  const double share = 100.0 * static_cast<double>(m.carried) / (seconds * baud / 10);
  std::printf(
      "line throughput at %7d baud, receiver %4d bytes:   %.1f %% of the line, %.0f lines/s; "
      "at most %d bytes held, %.1f unsent in the kernel  (wanted >= %.0f %%)\n",
      baud, receiver, share, static_cast<double>(m.lines) / seconds, m.receiver_peak, m.kernel_peak,
      wanted);
}

void holds_and_emergencies(const fs::path& programs, int holds, int emergencies) {
  Bench bench(programs, 115200, 128);
  const Audience audience(bench.socket(), 20);
  const fs::path folder = bench.make_job(milling(200000));
  auto job = bench.submit(folder);
  bench.start(job);
  bench.wait([&] { return bench.job(job).acknowledged > 200; });
  std::vector<double> hold, stop;
  const auto seen = [&](Instant Machine::*moment) {
    const std::lock_guard lock(bench.machine().mutex);
    return bench.machine().*moment;
  };
  const auto measure = [&](api::Method method, Instant Machine::*moment) {
    const Instant asked = now();
    bench.call(method);
    bench.wait([&] { return seen(moment) > asked; });
    return milliseconds(seen(moment) - asked);
  };
  for (int i = 0; i < holds; ++i) {
    hold.push_back(measure(api::Method::kHold, &Machine::last_hold));
    bench.wait([&] { return bench.rig_state() == "held"; });
    bench.call(api::Method::kResume);
    const std::int64_t from = bench.job(job).acknowledged;
    bench.wait([&] { return bench.job(job).acknowledged > from + 50; });
  }
  print_spread("hold, client to wire, 20 subscribers, streaming", hold, 5);
  for (int i = 0; i < emergencies; ++i) {
    stop.push_back(measure(api::Method::kEmergency, &Machine::last_reset));
    bench.wait([&] { return bench.rig_state() == "fault"; });
    bench.wait([&] {
      bench.call(api::Method::kClear);
      std::this_thread::sleep_for(std::chrono::milliseconds(500));
      return bench.rig_state() == "idle";
    });
    job = bench.submit(folder);
    bench.start(job);
    bench.wait([&] { return bench.job(job).acknowledged > 200; });
  }
  print_spread("emergency, client to wire", stop, 2);
}

void barriers(const fs::path& programs, int beads) {
  Bench bench(programs, 115200, 128);
  const auto job = bench.submit(bench.make_job(printing(beads)));
  bench.machine().restart_counting();
  bench.start(job);
  bench.wait([&] { return is_over(bench.job(job).state); }, 300);
  const api::JobReport report = bench.job(job);
  std::printf("barriers: job %s, %lld toggles\n", api::name_of(report.state),
              static_cast<long long>(report.toggles));
  const std::lock_guard lock(bench.machine().mutex);
  print_spread("barrier, Idle said to relay order read", bench.machine().idle_to_relay, 2);
  print_spread("barrier, done said to next line read", bench.machine().done_to_line, 2);
}

double cpu_seconds(pid_t pid) {
  std::ifstream in("/proc/" + std::to_string(pid) + "/stat");
  std::string text((std::istreambuf_iterator<char>(in)), {});
  std::istringstream rest(text.substr(text.rfind(')') + 2));
  std::string field;
  double ticks = 0;
  for (int i = 3; rest >> field && i <= 15; ++i) {
    if (i == 14 || i == 15) ticks += std::stod(field);
  }
  return ticks / static_cast<double>(sysconf(_SC_CLK_TCK));
}

void audience_and_memory(const fs::path& programs, int seconds) {
  Bench bench(programs, 115200, 128);
  const auto job = bench.submit(bench.make_job(milling(1000000)));
  bench.start(job);
  bench.wait([&] { return bench.job(job).acknowledged > 100; });
  const auto share = [&] {
    const double before = cpu_seconds(bench.pid());
    std::this_thread::sleep_for(std::chrono::seconds(seconds));
    return 100 * (cpu_seconds(bench.pid()) - before) / seconds;
  };
  const double alone = share();
  const Audience audience(bench.socket(), 100);
  const double watched = share();
  std::printf(
      "CPU of the daemon, streaming at 115200 baud: %.1f %% of a core; with 100 subscribers "
      "%.1f %%: %.1f %% for them, %.1f messages/s each  (wanted <= 5 %%)\n",
      alone, watched, watched - alone, static_cast<double>(audience.messages()) / 100 / seconds);
  std::ifstream in("/proc/" + std::to_string(bench.pid()) + "/status");
  for (std::string line; std::getline(in, line);) {
    if (line.starts_with("VmRSS") || line.starts_with("RssAnon") || line.starts_with("VmHWM")) {
      std::printf("memory with a 1,000,000-line job: %s\n", line.c_str());
    }
  }
  bench.abort(job);
}

void submission(const fs::path& programs) {
  Bench bench(programs, 115200, 128);
  const fs::path folder = bench.make_job(milling(10000000));
  const Instant began = now();
  const auto job = bench.submit(folder);
  std::printf(
      "submission of a 10,000,000-line job (%.0f MB), its verification apart: %.1f s, %s  "
      "(wanted <= 10 s)\n",
      static_cast<double>(fs::file_size(folder / "program.nc")) / 1e6,
      milliseconds(now() - began) / 1000, api::name_of(bench.job(job).state));
}

}  // namespace
}  // namespace reforge

int main(int argc, char** argv) {
  CLI::App app{"bench-controller: the daemon's figures"};
  std::string only;
  int holds = 100;
  app.add_option("--only", only, "throughput, hold, barrier, audience or submission");
  app.add_option("--holds", holds, "How often a hold is measured")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  const std::filesystem::path programs = std::filesystem::canonical("/proc/self/exe").parent_path();
  const auto wanted = [&](const char* name) { return only.empty() || only == name; };
  std::setvbuf(stdout, nullptr, _IOLBF, 0);
  try {
    if (wanted("throughput")) {
      reforge::throughput(programs, 115200, 128, 99);
      reforge::throughput(programs, 1000000, 128, 97);
      reforge::throughput(programs, 1000000, 1024, 97);
    }
    if (wanted("hold")) reforge::holds_and_emergencies(programs, holds, 6);
    if (wanted("barrier")) reforge::barriers(programs, 100);
    if (wanted("audience")) reforge::audience_and_memory(programs, 10);
    if (wanted("submission")) reforge::submission(programs);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "bench-controller: %s\n", e.what());
    return 4;
  }
  return 0;
}
