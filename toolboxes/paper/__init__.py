"""The reproduction of the paper: its cases, figures and claims in one report, with errata and assumptions."""
