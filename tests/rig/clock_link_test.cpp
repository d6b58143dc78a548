#include "tools/rig/clock_link.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <termios.h>

#include <cstring>
#include <thread>

#include "tests/rig/fake_board.h"
#include "tests/rig/scratch_folder.h"
#include "tests/rig/shipped_rig.h"
#include "tools/rig/rig_server.h"

namespace reforge {
namespace {

constexpr int64_t kNone = std::numeric_limits<int64_t>::max();

struct Tick {
  uint64_t number;
  int64_t now;
  uint64_t cnc_out, extruder_out;
};

// A whole rig with a fake board, served by a thread of its own, and the daemon's side of the clock
// link and the CNC's port in the test's hands.
struct Lockstep {
  Lockstep()
      : ports{std::move(PtyPort::create(folder.path / "cnc").value()),
              std::move(PtyPort::create(folder.path / "extruder").value()),
              std::move(ModemLines::listen(folder.path / "dtr.sock").value()),
              std::move(ClockLink::listen(folder.path / "clock").value())},
        rig(shipped_rig(), true, std::make_unique<FakeBoard>(board), nullptr),
        server(rig, ports, {std::nullopt, [](const std::string&) {}}),
        stop(eventfd(0, EFD_CLOEXEC)),
        cnc(::open((folder.path / "cnc").c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC)),
        thread([this] { server.run(stop.get()); }) {
    connect();
  }
  ~Lockstep() { finish(); }

  void finish() {
    const uint64_t one = 1;
    if (thread.joinable()) {
      EXPECT_EQ(::write(stop.get(), &one, sizeof one), 8);
      thread.join();
    }
  }

  void connect() {
    clock = FileHandle(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
    received.clear();
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::strcpy(address.sun_path, (folder.path / "clock").c_str());
    ASSERT_EQ(::connect(clock.get(), reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  }

  Tick next_tick() {
    while (received.find('\n') == std::string::npos) {
      char bytes[256];
      const ssize_t n = ::recv(clock.get(), bytes, sizeof bytes, 0);
      if (n <= 0) {
        ADD_FAILURE() << "the rig closed the clock link";
        return {};
      }
      received.append(bytes, static_cast<size_t>(n));
    }
    Tick tick{};
    const size_t end = received.find('\n');
    EXPECT_EQ(std::sscanf(received.substr(0, end).c_str(), "T %lu %ld %lu %lu", &tick.number,
                          &tick.now, &tick.cnc_out, &tick.extruder_out),
              4)
        << received;
    received.erase(0, end + 1);
    return tick;
  }

  void answer(uint64_t number, int64_t deadline) {
    const std::string line = "D " + std::to_string(number) + ' ' + std::to_string(deadline) +
                             " 0 " + std::to_string(cnc_written) + " 0 0\n";
    ASSERT_EQ(::send(clock.get(), line.data(), line.size(), MSG_NOSIGNAL),
              static_cast<ssize_t>(line.size()));
  }
  Tick answer_and_wait(const Tick& tick, int64_t deadline) {
    answer(tick.number, deadline);
    return next_tick();
  }
  // The first tick after which nothing more comes from the CNC by itself: its banner is through.
  Tick settled() {
    Tick tick = next_tick();
    while (true) {
      const Tick next = answer_and_wait(tick, kNone);
      if (next.cnc_out == tick.cnc_out) return next;
      tick = next;
    }
  }
  void write_cnc(const std::string& bytes) {
    ASSERT_EQ(::write(cnc.get(), bytes.data(), bytes.size()), static_cast<ssize_t>(bytes.size()));
    cnc_written += bytes.size();
  }
  std::string read_cnc(size_t count) {
    std::string bytes(count, '\0');
    size_t have = 0;
    while (have < count) {
      const ssize_t n = ::read(cnc.get(), bytes.data() + have, count - have);
      if (n <= 0) break;
      have += static_cast<size_t>(n);
    }
    bytes.resize(have);
    return bytes;
  }

  ScratchFolder folder;
  FakeBoardState board;
  RigServer::Ports ports;
  VirtualRig rig;
  RigServer server;
  FileHandle stop, cnc, clock;
  uint64_t cnc_written = 0;
  std::string received;
  std::thread thread;
};

TEST(ClockLink, OnlyAWholeAnswerIsRead) {
  const auto answer = parse_clock_answer("D 7 9223372036854775807 1 2 3 4");
  ASSERT_TRUE(answer.has_value());
  EXPECT_EQ(answer->tick, 7u);
  EXPECT_EQ(answer->deadline_ns, kNone);
  EXPECT_EQ(answer->extruder_out, 4u);
  for (const char* bad : {"", "D", "D 1 2 3 4 5", "D 1 2 3 4 5 6 7", "T 1 2 3 4 5 6",
                          "D 1  2 3 4 5 6", "D -1 2 3 4 5 6", "D 1 2 3 4 5 6 "}) {
    EXPECT_FALSE(parse_clock_answer(bad).has_value()) << bad;
  }
}

TEST(ClockLink, TimeGoesFromTickToDeadlineAndNeverFurtherThanTenMilliseconds) {
  Lockstep daemon;
  const Tick first = daemon.settled();
  const Tick second = daemon.answer_and_wait(first, first.now + 3'456'789);
  EXPECT_EQ(second.number, first.number + 1);
  EXPECT_EQ(second.now, first.now + 3'456'789);
  const Tick third = daemon.answer_and_wait(second, kNone);
  EXPECT_EQ(third.now, second.now + 10 * kNsPerMs);
}

TEST(ClockLink, AnswersComeWhenTheirBytesAreThroughTheWire) {
  Lockstep daemon;
  // To a whole millisecond, so that frames are easy to count.
  Tick tick = daemon.settled();
  tick = daemon.answer_and_wait(tick, (tick.now / kNsPerMs + 1) * kNsPerMs);
  daemon.read_cnc(tick.cnc_out);  // the banner
  daemon.write_cnc("\n");
  // 0.087 ms in, 0.4 ms to read it, 4 x 0.087 ms out.
  const Tick answered = daemon.answer_and_wait(tick, kNone);
  EXPECT_EQ(answered.now, tick.now + kNsPerMs);
  EXPECT_EQ(answered.cnc_out, tick.cnc_out + 4);
  EXPECT_EQ(daemon.read_cnc(4), "ok\r\n");
}

TEST(ClockLink, EverythingCountedIsTakenInBeforeTimeGoesOn) {
  Lockstep daemon;
  Tick tick = daemon.settled();
  daemon.write_cnc("G4 P0.005\n");
  const int64_t written = tick.now;
  const uint64_t before = tick.cnc_out;
  while (tick.cnc_out == before) tick = daemon.answer_and_wait(tick, kNone);
  EXPECT_GE(tick.now - written, 5 * kNsPerMs);
  EXPECT_LE(tick.now - written, 8 * kNsPerMs);
}

TEST(ClockLink, AnUnaskedAnswerIsNoAnswerToTheTickThatStands) {
  Lockstep daemon;
  const Tick first = daemon.settled();
  const Tick second = daemon.answer_and_wait(first, kNone);
  daemon.write_cnc("?");
  daemon.answer(first.number, kNone);  // crosses the second on the wire
  const Tick third = daemon.answer_and_wait(second, kNone);
  EXPECT_EQ(third.number, second.number + 1);
  EXPECT_GT(third.cnc_out, second.cnc_out);
}

TEST(ClockLink, AnAnswerToATickThatNeverWasEndsTheConversation) {
  Lockstep daemon;
  const Tick first = daemon.next_tick();
  daemon.answer(first.number + 5, kNone);
  char byte;
  EXPECT_EQ(::recv(daemon.clock.get(), &byte, 1, 0), 0);
}

TEST(ClockLink, ALaterDaemonStartsFromTheCountsOfItsFirstTick) {
  Lockstep daemon;
  Tick tick = daemon.settled();
  daemon.write_cnc("\n\n\n");
  const uint64_t before = tick.cnc_out;
  while (tick.cnc_out < before + 12) tick = daemon.answer_and_wait(tick, kNone);
  daemon.connect();  // the old connection closes
  daemon.cnc_written = 0;
  const Tick first = daemon.next_tick();
  EXPECT_EQ(first.number, 1u);
  EXPECT_EQ(first.cnc_out, tick.cnc_out);
  EXPECT_GE(first.now, tick.now);
  daemon.write_cnc("\n");
  tick = first;
  while (tick.cnc_out < first.cnc_out + 4) tick = daemon.answer_and_wait(tick, kNone);
  EXPECT_EQ(tick.cnc_out, first.cnc_out + 4);
}

// Opening the extruder's port as the preloaded library tells of it; closing is the handle's end.
FileHandle open_extruder(Lockstep& daemon) {
  FileHandle program(::socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0));
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strcpy(address.sun_path, (daemon.folder.path / "dtr.sock").c_str());
  const std::string message = "open " + daemon.ports.extruder.device();
  EXPECT_EQ(::connect(program.get(), reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  EXPECT_EQ(::send(program.get(), message.data(), message.size(), 0),
            static_cast<ssize_t>(message.size()));
  return program;
}

TEST(ClockLink, OpeningTheExtrudersPortResetsTheBoardUnlessDtrStayedHigh) {
  Lockstep daemon;
  Tick tick = daemon.settled();
  FileHandle program = open_extruder(daemon);
  tick = daemon.answer_and_wait(tick, kNone);
  EXPECT_EQ(daemon.board.resets, 1);
  // Closed with HUPCL set, as a terminal has it: DTR falls, and opening raises it again.
  program = FileHandle();
  tick = daemon.answer_and_wait(tick, kNone);
  program = open_extruder(daemon);
  tick = daemon.answer_and_wait(tick, kNone);
  EXPECT_EQ(daemon.board.resets, 2);
  const FileHandle slave(::open(daemon.ports.extruder.device().c_str(), O_RDWR | O_NOCTTY));
  termios settings{};
  ASSERT_EQ(tcgetattr(slave.get(), &settings), 0);
  settings.c_cflag &= ~static_cast<tcflag_t>(HUPCL);
  ASSERT_EQ(tcsetattr(slave.get(), TCSANOW, &settings), 0);
  program = FileHandle();
  tick = daemon.answer_and_wait(tick, kNone);
  program = open_extruder(daemon);
  daemon.answer_and_wait(tick, kNone);
  EXPECT_EQ(daemon.board.resets, 2);
}

TEST(ClockLink, TheBoardsTimeIsTheCncsTime) {
  Lockstep daemon;
  Tick tick = daemon.next_tick();
  for (int i = 0; i < 20; ++i) tick = daemon.answer_and_wait(tick, tick.now + 7'654'321);
  daemon.finish();
  EXPECT_EQ(daemon.board.now, daemon.rig.now_ns());
}

}  // namespace
}  // namespace reforge
