#include "protocols/gcode/line.h"

#include <charconv>
#include <cmath>

namespace reforge::gcode {
namespace {

// A physical line is cut off here, whatever the dialect: nobody's line is longer.
constexpr std::size_t kBytesMax = 4096;

std::string where(std::size_t number, std::size_t column) {
  return "line " + std::to_string(number) + ", column " + std::to_string(column) + ": ";
}

std::string shown(char c) {
  const auto byte = static_cast<unsigned char>(c);
  if (byte >= 0x20 && byte < 0x7f) return std::string("'") + c + "'";
  constexpr char kHex[] = "0123456789abcdef";
  return std::string("byte 0x") + kHex[byte >> 4] + kHex[byte & 15];
}

std::string_view trimmed(std::string_view s) {
  while (!s.empty() && (s.front() == ' ' || s.front() == '\t')) s.remove_prefix(1);
  while (!s.empty() && (s.back() == ' ' || s.back() == '\t')) s.remove_suffix(1);
  return s;
}

bool digit(char c) {
  return c >= '0' && c <= '9';
}

// A decimal number without exponent: [+-] digits [. digits]. Returns how many characters it took.
std::size_t parse_number(std::string_view s, double& value) {
  std::size_t i = 0;
  if (i < s.size() && (s[i] == '+' || s[i] == '-')) ++i;
  const std::size_t first = i;
  std::size_t digits = 0;
  while (i < s.size() && digit(s[i])) ++i, ++digits;
  if (i < s.size() && s[i] == '.') {
    ++i;
    while (i < s.size() && digit(s[i])) ++i, ++digits;
  }
  if (digits == 0) return 0;
  const auto [end, error] =
      std::from_chars(s.data() + first, s.data() + i, value, std::chars_format::fixed);
  if (error != std::errc() || end != s.data() + i || !std::isfinite(value)) return 0;
  if (s[0] == '-') value = -value;
  return i;
}

}  // namespace

Status parse_line(std::string_view text, std::size_t number, const Dialect& dialect, Line& line) {
  line.number = number;
  line.text.assign(text);
  line.comment.clear();
  line.percent = false;
  line.word_count = 0;
  if (text.size() > dialect.line_length_max) {
    return Status::fail(Code::kOutOfRange, "line " + std::to_string(number) + ": " +
                                               std::to_string(text.size()) +
                                               " characters; the controller takes at most " +
                                               std::to_string(dialect.line_length_max));
  }
  const auto fail = [&](std::size_t at, const std::string& sentence) {
    return Status::fail(Code::kMalformed, where(number, at + 1) + sentence);
  };

  if (dialect.percent_lines && trimmed(text) == "%") {
    line.percent = true;
    return Unit{};
  }
  std::size_t i = 0;
  while (i < text.size()) {
    const char c = text[i];
    if (c == ' ' || c == '\t') {
      ++i;
      continue;
    }
    if (c == ';' && dialect.semicolon_comments) {
      line.comment.assign(trimmed(text.substr(i + 1)));
      break;
    }
    if (c == '(' && dialect.parenthesis_comments) {
      const std::size_t close = text.find(')', i);
      if (close == std::string_view::npos) return fail(i, "a comment opened by '(' has no ')'");
      const std::string_view inner = text.substr(i + 1, close - i - 1);
      if (inner.find('(') != std::string_view::npos) return fail(i, "comments cannot be nested");
      line.comment.assign(trimmed(inner));
      i = close + 1;
      continue;
    }
    char letter = c;
    if (letter >= 'a' && letter <= 'z') letter = static_cast<char>(letter - 'a' + 'A');
    if (letter < 'A' || letter > 'Z') {
      return fail(i, "expected a word (letter and number) or a comment, found " + shown(c));
    }
    std::size_t at = i + 1;
    while (at < text.size() && (text[at] == ' ' || text[at] == '\t')) ++at;
    double value = 0;
    const std::size_t taken = parse_number(text.substr(at), value);
    if (taken == 0) {
      return fail(at,
                  std::string("expected a number after ") + letter + ", found " +
                      (at < text.size() ? shown(text[at]) : std::string("the end of the line")));
    }
    if (line.word_count == kWordsMax) return fail(i, "more than 24 words on one line");
    line.words[line.word_count++] = Word{letter, value, static_cast<int>(i + 1)};
    i = at + taken;
  }
  return Unit{};
}

std::string compact(const Line& line) {
  std::string out;
  bool in_parenthesis = false;
  for (const char c : line.text) {
    if (in_parenthesis) {
      in_parenthesis = c != ')';
    } else if (c == '(') {
      in_parenthesis = true;
    } else if (c == ';') {
      break;
    } else if (c != ' ' && c != '\t') {
      out += c;
    }
  }
  return out;
}

Result<bool> LineReader::next(Line& line) {
  buffer_.clear();
  int c = in_.get();
  if (c == std::istream::traits_type::eof()) {
    if (in_.bad()) return Result<bool>::fail(Code::kUnreadable, "the program could not be read on");
    return false;
  }
  ++number_;
  for (; c != std::istream::traits_type::eof() && c != '\n'; c = in_.get()) {
    if (buffer_.size() == kBytesMax) {
      while (c != std::istream::traits_type::eof() && c != '\n') c = in_.get();
      return Result<bool>::fail(Code::kOutOfRange,
                                "line " + std::to_string(number_) + ": more than 4096 characters");
    }
    buffer_ += static_cast<char>(c);
  }
  if (!buffer_.empty() && buffer_.back() == '\r') buffer_.pop_back();
  Status parsed = parse_line(buffer_, number_, dialect_, line);
  if (!parsed) return parsed.error();
  return true;
}

}  // namespace reforge::gcode
