// The whole virtual rig with the real firmware: what the trace says of a bead.
#include "tools/rig/avr_extruder.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/rig/shipped_rig.h"
#include "tools/rig/virtual_rig.h"

namespace reforge {
namespace {

struct KeptTrace final : Trace {
  void write(const TraceRecord& record) override { records.push_back(record); }
  const TraceRecord* last(const std::string& event) const {
    for (auto record = records.rbegin(); record != records.rend(); ++record) {
      if (record->event == event) return &*record;
    }
    return nullptr;
  }
  std::vector<TraceRecord> records;
};

// A host that greets the board, keeps it fed with heartbeats and waits for its `done`.
struct Host {
  Host() {
    auto opened = AvrBoard::open(REFORGE_FIRMWARE_ELF);
    EXPECT_TRUE(opened.ok());
    board = (*opened).get();
    rig = std::make_unique<VirtualRig>(shipped_rig(), true,
                                       std::make_unique<AvrExtruder>(std::move(*opened)), &trace);
    run(kNsPerSecond);
    send(wire::pack(wire::Hello{wire::kProtocolVersion, 77}, 0));
    run(100 * kNsPerMs);
  }
  void send(const wire::Frame& frame) {
    uint8_t bytes[wire::kFrameMax];
    const uint8_t n = wire::encode(frame, bytes);
    rig->host_wrote(Link::kExtruder, {reinterpret_cast<const char*>(bytes), n});
  }
  void run(int64_t ns) {
    const int64_t end = rig->now_ns() + ns;
    while (rig->now_ns() < end) {
      if (rig->now_ns() >= next_beat) {
        send(wire::Packer(wire::Type::kHeartbeat, 0).frame());
        next_beat = rig->now_ns() + 100 * kNsPerMs;
      }
      rig->advance(std::min(end, next_beat));
      for (const char byte : rig->take_for_host(Link::kExtruder)) {
        decoder.push(static_cast<uint8_t>(byte));
        wire::Frame frame;
        while (decoder.take(frame)) {
          wire::Done message{};
          if (wire::unpack(frame, message)) done.push_back(message.reason);
        }
      }
    }
  }
  // Until the order is done, at most 30 s.
  wire::Reason order(uint8_t m_code, int32_t argument = wire::kUseSetting) {
    done.clear();
    send(wire::pack(wire::Command{m_code, argument}, ++sequence));
    for (int i = 0; i < 3000 && done.empty(); ++i) run(10 * kNsPerMs);
    return done.empty() ? wire::Reason::kPending : done.front();
  }

  KeptTrace trace;
  AvrBoard* board = nullptr;
  std::unique_ptr<VirtualRig> rig;
  wire::Decoder decoder;
  std::vector<wire::Reason> done;
  uint8_t sequence = 0;
  int64_t next_beat = 0;
};

TEST(AvrExtruder, StepsBetweenOnAndOffAreRateTimesTime) {
  Host host;
  host.board->hot_end().set_temperature(205);
  ASSERT_EQ(host.order(70), wire::Reason::kNone);
  host.rig->host_wrote(Link::kCnc, "G91 G1 X-40 F600\n");
  ASSERT_EQ(host.order(72, 350), wire::Reason::kNone);  // 0.35 mm/s
  host.run(3 * kNsPerSecond);
  ASSERT_EQ(host.order(73), wire::Reason::kNone);
  host.run(200 * kNsPerMs);

  const TraceRecord* on = host.trace.last("extrude_on");
  const TraceRecord* off = host.trace.last("extrude_off");
  ASSERT_NE(on, nullptr);
  ASSERT_NE(off, nullptr);
  const double seconds = static_cast<double>(off->ns - on->ns) / 1e9;
  const double steps = off->fields["steps"].get<double>() - on->fields["steps"].get<double>();
  const double expected = 0.35 * seconds * shipped_rig().extrusion.steps_per_mm;
  EXPECT_NEAR(steps, expected, 0.01 * expected);
  EXPECT_EQ(off->fields["steps"], host.rig->filament_steps());
  EXPECT_EQ(off->fields["by"], "M73");
  // The tool moved on at 10 mm/s meanwhile.
  EXPECT_NEAR(on->fields["x"].get<double>() - off->fields["x"].get<double>(), 10 * seconds, 0.3);
}

TEST(AvrExtruder, SilenceEndsTheBeadAndHoldsTheCnc) {
  Host host;
  host.board->hot_end().set_temperature(205);
  ASSERT_EQ(host.order(70), wire::Reason::kNone);
  ASSERT_EQ(host.order(72, 350), wire::Reason::kNone);
  host.rig->host_wrote(Link::kCnc, "G91 G1 X-90 F600\n");
  host.next_beat = kNeverNs;  // the host falls silent
  host.run(kNsPerSecond);
  ASSERT_NE(host.trace.last("extrude_off"), nullptr);
  EXPECT_EQ(host.trace.last("extrude_off")->fields["by"], "fault");
  host.run(kNsPerSecond);
  EXPECT_EQ(host.rig->cnc().state_name(), "Hold:0");
  EXPECT_EQ(host.trace.last("hold")->fields["by"], "input");
}

TEST(AvrExtruder, DtrResetsTheFirmwareAndDropsTheHoldOutput) {
  Host host;
  EXPECT_EQ(host.trace.last("permit")->fields["run"], true);
  host.rig->dtr(Link::kExtruder, true);
  host.run(100 * kNsPerMs);
  EXPECT_EQ(host.trace.last("permit")->fields["run"], false);
  EXPECT_EQ(host.rig->cnc().state_name(), "Hold:0");
}

}  // namespace
}  // namespace reforge
