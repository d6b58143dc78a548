// Frames and messages of protocols/extruder_wire.h.

#include "protocols/extruder_wire.h"

#include <gtest/gtest.h>

#include <random>
#include <set>
#include <string>
#include <vector>

#include "protocols/extruder_text.h"

namespace reforge::wire {
namespace {

using Bytes = std::vector<uint8_t>;

Bytes bytes_of(const Frame& frame) {
  Bytes out(kFrameMax);
  out.resize(encode(frame, out.data()));
  return out;
}

std::vector<Frame> decode(const Bytes& bytes) {
  Decoder decoder;
  std::vector<Frame> frames;
  Frame frame;
  for (const uint8_t byte : bytes) {
    decoder.push(byte);
    while (decoder.take(frame)) frames.push_back(frame);
  }
  return frames;
}

TEST(Wire, CrcIsTheCatalogued) {
  uint16_t crc = kCrcStart;
  for (const char c : std::string("123456789")) crc = crc_step(crc, static_cast<uint8_t>(c));
  EXPECT_EQ(crc, 0x29B1);
}

TEST(Wire, BytesOfACommandAreThoseOfTheFormat) {
  // Sync, 5 bytes of payload, sequence 3, command, M72, 350 little-endian.
  const Bytes expected = {0xA5, 5, 3, 0x10, 72, 0x5E, 0x01, 0, 0};
  const Bytes bytes = bytes_of(pack(Command{72, 350}, 3));
  ASSERT_EQ(bytes.size(), expected.size() + 2);
  EXPECT_EQ(Bytes(bytes.begin(), bytes.end() - 2), expected);
}

template <typename Message>
Message there_and_back(const Message& message) {
  const std::vector<Frame> frames = decode(bytes_of(pack(message, 200)));
  EXPECT_EQ(frames.size(), 1u);
  EXPECT_EQ(frames[0].sequence, 200);
  Message back = {};
  EXPECT_TRUE(unpack(frames[0], back));
  Frame longer = frames[0];
  ++longer.length;
  EXPECT_FALSE(unpack(longer, back));
  Frame other = frames[0];
  other.type = Type::kHeartbeat;
  EXPECT_FALSE(unpack(other, back));
  return back;
}

TEST(Wire, EveryMessageComesBackAsItWent) {
  EXPECT_EQ(there_and_back(Hello{1, 0xBEEF}).session, 0xBEEF);
  EXPECT_EQ(there_and_back(Command{74, -123456}).argument, -123456);
  EXPECT_EQ(there_and_back(GetSetting{Setting::kPidD}).id, Setting::kPidD);
  EXPECT_EQ(there_and_back(SetSetting{Setting::kSilence, 3000}).value, 3000);
  EXPECT_EQ(there_and_back(SettingValue{Setting::kSilence, -1}).value, -1);
  EXPECT_EQ(there_and_back(Ack{Reason::kBusy, State::kOpening}).reason, Reason::kBusy);
  EXPECT_EQ(there_and_back(Done{Reason::kNone, State::kReady, -70000}).position, -70000);
  EXPECT_EQ(there_and_back(Beat{State::kFault, Fault::kRunaway}).fault, Fault::kRunaway);
  EXPECT_EQ(there_and_back(FaultReport{Fault::kNoRise, State::kOpening, -5, 9}).temperature, -5);
  const Banner banner =
      there_and_back(Banner{1, 2, 3, 4, 5, 0x6789, 0xABCD, State::kReady, Fault::kSilence});
  EXPECT_EQ(banner.config_hash, 0x6789);
  EXPECT_EQ(banner.fault, Fault::kSilence);
  const Status status =
      there_and_back(Status{State::kRestoring, Fault::kNone, 7, kTemperatureUnknown, 2050, -1, 2, 3,
                            4, Reason::kPending, 0xFEDCBA98});
  EXPECT_EQ(status.temperature, kTemperatureUnknown);
  EXPECT_EQ(status.position, -1);
  EXPECT_EQ(status.last_result, Reason::kPending);
  EXPECT_EQ(status.uptime, 0xFEDCBA98u);
}

TEST(Decoder, LeavesTextToOthers) {
  Decoder decoder;
  EXPECT_FALSE(decoder.push('M'));
  EXPECT_TRUE(decoder.push(kSync));
  EXPECT_TRUE(decoder.push('M'));
}

TEST(Decoder, AFlippedBitCostsOneFrameOnly) {
  const Bytes good = bytes_of(pack(Command{72, 350}, 3));
  for (size_t bit = 0; bit < good.size() * 8; ++bit) {
    Bytes stream = good;
    stream[bit / 8] ^= static_cast<uint8_t>(1 << (bit % 8));
    // A length that now claims more than was sent is only known as wrong once that much has come.
    for (int i = 0; i < 5; ++i) stream.insert(stream.end(), good.begin(), good.end());
    const std::vector<Frame> frames = decode(stream);
    ASSERT_EQ(frames.size(), 5u) << "bit " << bit;
  }
}

TEST(Decoder, FindsAFrameInsideABrokenOne) {
  Bytes stream = {kSync, 30, 1};  // its rest was lost
  const Bytes good = bytes_of(pack(Type::kHeartbeat, 9));
  stream.insert(stream.end(), good.begin(), good.end());
  Decoder decoder;
  Frame frame;
  for (const uint8_t byte : stream) decoder.push(byte);
  EXPECT_FALSE(decoder.take(frame));
  decoder.gap();
  ASSERT_TRUE(decoder.take(frame));
  EXPECT_EQ(frame.sequence, 9);
  EXPECT_FALSE(decoder.in_frame());
  EXPECT_EQ(decoder.rejected(), 1);
}

TEST(Decoder, PayloadFullOfSyncsIsAFrame) {
  Frame frame;
  frame.length = kPayloadMax;
  for (uint8_t& byte : frame.payload) byte = kSync;
  EXPECT_EQ(decode(bytes_of(frame)).size(), 1u);
}

TEST(Decoder, FramesInNoiseAreAllFoundAfterAGap) {
  std::mt19937 engine(1);
  const auto random = [&engine] { return static_cast<uint32_t>(engine()); };
  int found = 0;
  Decoder decoder;
  Frame frame;
  for (int round = 0; round < 20000; ++round) {
    for (unsigned n = random() % 50; n > 0; --n) {
      decoder.push(static_cast<uint8_t>(random() % 4 == 0 ? kSync : random()));
      while (decoder.take(frame)) {
      }
    }
    while (decoder.in_frame()) {
      decoder.gap();
      while (decoder.take(frame)) {
      }
    }
    for (const uint8_t byte : bytes_of(pack(Command{70, round}, 1))) decoder.push(byte);
    Command command = {};
    if (decoder.take(frame) && unpack(frame, command) && command.argument == round) ++found;
  }
  EXPECT_EQ(found, 20000);
}

TEST(Text, EveryCodeHasANameAndASentence) {
  std::set<std::string_view> sentences;
  for (uint8_t i = 0; i < kStateCount; ++i) sentences.insert(sentence_of(static_cast<State>(i)));
  for (uint8_t i = 0; i < kReasonCount; ++i) sentences.insert(sentence_of(static_cast<Reason>(i)));
  for (uint8_t i = 0; i < kFaultCount; ++i) sentences.insert(sentence_of(static_cast<Fault>(i)));
  EXPECT_EQ(sentences.size(), size_t{kStateCount + kReasonCount + kFaultCount});
  EXPECT_EQ(sentences.count(""), 0u);
  std::set<std::string_view> settings;
  for (uint8_t i = 0; i < kSettingCount; ++i) settings.insert(name_of(static_cast<Setting>(i)));
  EXPECT_EQ(settings.size(), size_t{kSettingCount});
  EXPECT_EQ(settings.count(""), 0u);
}

TEST(Text, UnknownCodesSaySo) {
  EXPECT_EQ(name_of(static_cast<State>(200)), "unknown code");
  EXPECT_EQ(name_of(static_cast<Setting>(200)), "unknown code");
  EXPECT_EQ(reset_cause_text(0), "unknown");
  EXPECT_EQ(reset_cause_text(kResetWatchdog | kResetExternal), "watchdog");
  EXPECT_EQ(reset_cause_text(kResetBrownOut | kResetPowerOn), "brown-out");
  EXPECT_EQ(reset_cause_text(kResetExternal), "button or port opened");
  EXPECT_EQ(reset_cause_text(kResetPowerOn), "power on");
}

}  // namespace
}  // namespace reforge::wire
