#include "protocols/gcode/line.h"

#include <gtest/gtest.h>

#include <sstream>

namespace reforge::gcode {
namespace {

const Dialect kGrbl = dialect_of(CncDialect::kGrbl, 80, RotaryTable::kBC);
const Dialect kFanuc = dialect_of(CncDialect::kFanuc, 80, RotaryTable::kBC);

std::string error_of(std::string_view text, const Dialect& dialect = kGrbl) {
  Line line;
  const Status parsed = parse_line(text, 7, dialect, line);
  return parsed ? "" : parsed.error().sentence;
}

TEST(GcodeLine, WordsKeepLetterValueAndColumn) {
  Line line;
  ASSERT_TRUE(parse_line("  g1 X-1.5 Y +.25Z3. ; to the wall", 12, kGrbl, line));
  ASSERT_EQ(line.word_count, 4u);
  EXPECT_EQ(line.words[0].letter, 'G');
  EXPECT_EQ(line.words[0].column, 3);
  EXPECT_EQ(line.words[1].value, -1.5);
  EXPECT_EQ(line.words[2].value, 0.25);
  EXPECT_EQ(line.words[3].value, 3.0);
  EXPECT_EQ(line.words[3].column, 18);
  EXPECT_EQ(line.comment, "to the wall");
  EXPECT_EQ(line.number, 12u);
}

TEST(GcodeLine, BlankAndCommentLinesHaveNoWords) {
  Line line;
  for (const char* text : {"", "   \t", "; a comment", "(a comment)", "%"}) {
    ASSERT_TRUE(parse_line(text, 1, kGrbl, line)) << text;
    EXPECT_TRUE(line.empty()) << text;
  }
  EXPECT_TRUE(line.percent);
}

TEST(GcodeLine, ParenthesesCommentInsideALineIsStripped) {
  Line line;
  ASSERT_TRUE(parse_line("G0 (up) Z5", 1, kFanuc, line));
  EXPECT_EQ(line.word_count, 2u);
  EXPECT_EQ(line.comment, "up");
  EXPECT_EQ(compact(line), "G0Z5");
}

TEST(GcodeLine, ErrorsNameLineColumnAndExpectation) {
  EXPECT_EQ(error_of("G1 X"),
            "line 7, column 5: expected a number after X, found the end of the line");
  EXPECT_EQ(error_of("G1 Xa"), "line 7, column 5: expected a number after X, found 'a'");
  EXPECT_EQ(error_of("G1 #5"),
            "line 7, column 4: expected a word (letter and number) or a comment, found '#'");
  EXPECT_EQ(error_of("G1 X1 e"),
            "line 7, column 8: expected a number after E, found the end of the line");
  EXPECT_EQ(error_of("(open"), "line 7, column 1: a comment opened by '(' has no ')'");
  EXPECT_EQ(error_of("G1 X\x80"), "line 7, column 5: expected a number after X, found byte 0x80");
}

TEST(GcodeLine, FanucTakesNoSemicolonComment) {
  EXPECT_NE(error_of("; comment", kFanuc), "");
}

TEST(GcodeLine, NanInfinityAndHexAreNoNumbers) {
  EXPECT_NE(error_of("G1 Xnan"), "");
  EXPECT_NE(error_of("G1 Xinf"), "");
  EXPECT_NE(error_of("G1 X--1"), "");
  EXPECT_NE(error_of("G1 X."), "");
}

TEST(GcodeLine, LongerThanTheDialectTakesIsOutOfRange) {
  Line line;
  EXPECT_TRUE(parse_line("; " + std::string(78, 'x'), 1, kGrbl, line));
  const Status parsed = parse_line("; " + std::string(79, 'x'), 1, kGrbl, line);
  ASSERT_FALSE(parsed);
  EXPECT_EQ(parsed.error().code, Code::kOutOfRange);
}

TEST(GcodeLineReader, ReadsLineByLineWithEitherEndOfLine) {
  std::istringstream in("G21\r\nG90\n\nG0 Z5");
  LineReader reader(in, kGrbl);
  Line line;
  for (std::size_t n = 1; n <= 4; ++n) {
    const Result<bool> read = reader.next(line);
    ASSERT_TRUE(read && *read);
    EXPECT_EQ(line.number, n);
  }
  EXPECT_EQ(line.word_count, 2u);
  const Result<bool> end = reader.next(line);
  ASSERT_TRUE(end);
  EXPECT_FALSE(*end);
}

TEST(GcodeLineReader, HoldsNoMoreThanABoundedLine) {
  std::istringstream in(std::string(100000, 'X') + "\nG21\n");
  LineReader reader(in, kGrbl);
  Line line;
  EXPECT_FALSE(reader.next(line));
  const Result<bool> read = reader.next(line);
  ASSERT_TRUE(read && *read);
  EXPECT_EQ(line.number, 2u);
}

}  // namespace
}  // namespace reforge::gcode
