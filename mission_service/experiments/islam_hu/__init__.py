"""Run the experiments of Islam & Hu, section VI: one vehicle follows the front of six fires."""
